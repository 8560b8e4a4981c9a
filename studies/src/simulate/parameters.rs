//! What a simulated cluster is made of: what things cost, how large messages are, which machines there are.

use serde::{Deserialize, Serialize};

/// Costs of one process that has a core to itself, sizes and links. The defaults are round numbers of the order of what
/// terrain:500000 takes on one core with the software driver (200×150 views, four 400×300 samples); `argus study cluster`
/// prints those that it measures, to be given in their place.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Parameters {
    /// g: milliseconds for a sample.
    pub sample_ms: f64,
    /// c: milliseconds for a view from samples.
    pub view_ms: f64,
    /// g_direct: milliseconds for a view from the triangles.
    pub direct_ms: f64,
    /// The share of g that is done on all cores of a machine at a time, as packets of rays on the processor are; the rest, and
    /// all of c, is one thread's.
    pub sample_pooled: f64,
    /// The share of g_direct that is done on all cores of a machine at a time.
    pub direct_pooled: f64,
    /// For a compositor to take one sample up, on the thread that renders.
    pub hold_ms: f64,
    /// For a frame to be packed and sent, beside rendering.
    pub encode_ms: f64,
    /// For a sample to be packed, beside rendering, once by who rendered it: whoever received it passes it on as it came.
    pub pack_ms: f64,
    /// For a sample to be received and unpacked, beside rendering.
    pub unpack_ms: f64,
    /// Of the coordinator, for a view: to decide, and to relay its frame.
    pub relay_ms: f64,
    /// Of the client, for a view: to ask, receive and unpack.
    pub client_ms: f64,
    /// Bytes of a sample on the wire.
    pub sample_bytes: u64,
    /// Bytes of a frame on the wire.
    pub frame_bytes: u64,
    /// Bytes a second of each machine's link, in each direction.
    pub link_bytes_per_sec: f64,
    /// One way, between any two processes.
    pub latency_ms: f64,
    /// Which machines there are.
    pub machines: Machines,
    /// Whether frames pass the coordinator; if not, clients are connected to workers.
    pub relayed: bool,
}

/// Which machines there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Machines {
    /// All processes, the coordinator's and the clients' too, share the cores of one.
    Shared {
        /// Of that machine.
        cores: u32,
    },
    /// Each worker has one of its own, and so has the coordinator; clients have as many as they need.
    Each {
        /// Of each.
        cores: u32,
    },
}

impl Machines {
    /// Of one machine.
    pub fn cores(self) -> u32 {
        match self {
            Self::Shared { cores } | Self::Each { cores } => cores,
        }
    }
}

impl Parameters {
    /// g, g_direct and c by the clock, milliseconds, where so many processes are busy.
    pub(crate) fn by_the_clock(&self, processes: u32) -> [f64; 3] {
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
            // The paper's gigabit Ethernet would carry 1.25e8; ten of them are usual now.
            link_bytes_per_sec: 1.25e9,
            latency_ms: 0.1,
            machines: Machines::Each { cores: 2 },
            relayed: true,
        }
    }
}
