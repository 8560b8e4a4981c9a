//! The parameters of a simulated cluster: costs, message sizes, machines and links.

use serde::{Deserialize, Serialize};

/// Costs of a process with a core of its own, sizes and links. The defaults are round numbers near those of
/// terrain:500000 on one core with the software driver (200×150 views, four 400×300 samples). `argus-lab study load cluster`
/// prints measured ones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Parameters {
    /// g: milliseconds for a sample.
    pub sample_ms: f64,
    /// c: milliseconds for a view from samples.
    pub view_ms: f64,
    /// g_direct: milliseconds for a view from the triangles.
    pub direct_ms: f64,
    /// Share of g that runs on all cores of a machine at once, such as ray packets on the CPU. The rest of g, and all
    /// of c, runs on one thread.
    pub sample_pooled: f64,
    /// Share of g_direct that runs on all cores of a machine at once.
    pub direct_pooled: f64,
    /// Milliseconds for a compositor to hold a received sample, on the render thread.
    pub hold_ms: f64,
    /// Milliseconds to pack and send a frame, beside rendering.
    pub encode_ms: f64,
    /// Milliseconds to pack a sample, beside rendering; once at its sampler, since receivers forward it as packed.
    pub pack_ms: f64,
    /// Milliseconds to receive and unpack a sample, beside rendering.
    pub unpack_ms: f64,
    /// Milliseconds of the coordinator per view, to decide and to relay its frame.
    pub relay_ms: f64,
    /// Milliseconds of the client per view, to send the request, receive and unpack.
    pub client_ms: f64,
    /// Bytes of a sample on the wire.
    pub sample_bytes: u64,
    /// Bytes of a frame on the wire.
    pub frame_bytes: u64,
    /// Bytes per second of each machine's link, in each direction.
    pub link_bytes_per_sec: f64,
    /// One-way latency in milliseconds between any two processes.
    pub latency_ms: f64,
    /// The machines of the cluster.
    pub machines: Machines,
    /// Whether the coordinator relays frames; otherwise clients connect to workers.
    pub relayed: bool,
}

/// The machines of a cluster.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Machines {
    /// All processes share one machine, including the coordinator and the clients.
    Shared {
        /// Cores of the machine.
        cores: u32,
    },
    /// Each worker and the coordinator has its own machine; clients have as many as they need.
    Each {
        /// Cores of each machine.
        cores: u32,
    },
}

impl Machines {
    /// Cores of one machine.
    pub fn cores(self) -> u32 {
        match self {
            Self::Shared { cores } | Self::Each { cores } => cores,
        }
    }
}

impl Parameters {
    /// g, g_direct and c as wall milliseconds while `processes` processes are busy.
    pub(crate) fn wall_ms(&self, processes: u32) -> [f64; 3] {
        let cores = match self.machines {
            Machines::Shared { cores } => f64::from(cores) / f64::from(processes.max(1)),
            Machines::Each { cores } => f64::from(cores),
        };
        let of = |ms: f64, pooled: f64| ms * (1.0 - pooled + pooled / cores.max(1.0));
        [of(self.sample_ms, self.sample_pooled), of(self.direct_ms, self.direct_pooled), self.view_ms]
    }
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            sample_ms: 60.0,
            view_ms: 2.0,
            direct_ms: 30.0,
            sample_pooled: 0.0,
            direct_pooled: 0.0,
            hold_ms: 1.5,
            encode_ms: 0.8,
            pack_ms: 8.0,
            unpack_ms: 5.0,
            relay_ms: 0.15,
            client_ms: 0.3,
            sample_bytes: 500_000,
            frame_bytes: 60_000,
            // The paper's gigabit Ethernet carries 1.25e8; ten gigabits are usual now.
            link_bytes_per_sec: 1.25e9,
            latency_ms: 0.1,
            machines: Machines::Each { cores: 2 },
            relayed: true,
        }
    }
}
