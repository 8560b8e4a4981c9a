//! Loss of a real device under the real roles, during their work. Every request is still answered, on the next device,
//! with the same image.

use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use argus_client::{Client, RenderOptions};
use argus_cluster::leadership::LocalRegistry;
use argus_cluster::{RoleFactory, SceneFile, SceneOpener, SceneRef, SceneSource, coordinator, core, worker};
use argus_compositor::GpuCompositor;
use argus_gpu::{Gpu, GpuOptions};
use argus_sampler::GpuSampler;
use argus_scene::{Compositor, Holes, Output, PlanRequest, RenderError, SampleSetInfo, Sampler, Scene, View};
use tokio::net::TcpListener;
use tokio::task::JoinSet;
use tokio_util::sync::CancellationToken;

const SCENE: &str = "terrain:20000";
const PATIENCE: Duration = Duration::from_secs(60);

/// A machine whose device can be destroyed.
#[derive(Default)]
struct Machine {
    gpu: Mutex<Option<Arc<Gpu>>>,
    opened: AtomicUsize,
}

impl Machine {
    fn gpu(&self) -> Result<Arc<Gpu>, RenderError> {
        let mut held = self.gpu.lock().unwrap();
        if let Some(gpu) = held.as_ref().filter(|gpu| gpu.lost().is_none()) {
            return Ok(gpu.clone());
        }
        self.opened.fetch_add(1, Ordering::SeqCst);
        let gpu = Gpu::new(&GpuOptions::default()).map_err(|error| error.into_render())?;
        *held = Some(gpu.clone());
        Ok(gpu)
    }

    /// Imitates a driver's reset: the device's memory is lost, and the device refuses all work.
    fn lose(&self) {
        let gpu = self.gpu.lock().unwrap().clone().unwrap();
        gpu.device.destroy();
    }
}

impl RoleFactory for Machine {
    fn sampler(&self, scene: Arc<Scene>, _set: &SampleSetInfo) -> Result<Box<dyn Sampler>, RenderError> {
        Ok(Box::new(GpuSampler::new(self.gpu()?, scene)?))
    }

    fn compositor(&self) -> Result<Box<dyn Compositor>, RenderError> {
        Ok(Box::new(GpuCompositor::new(self.gpu()?)?))
    }
}

/// A source of a single scene.
struct Served(Arc<Scene>);

impl SceneSource for Served {
    fn scene(&self) -> &Arc<Scene> {
        &self.0
    }

    fn procedural(&self) -> Option<String> {
        Some(SCENE.to_owned())
    }

    fn files(&self) -> Result<Vec<(String, PathBuf)>, String> {
        Ok(Vec::new())
    }
}

impl SceneOpener for Served {
    fn open_local(&self, _reference: &SceneRef) -> Result<Option<Arc<Scene>>, String> {
        Ok(Some(self.0.clone()))
    }

    fn open_procedural(&self, _spec: &str) -> Result<Arc<Scene>, String> {
        Ok(self.0.clone())
    }

    fn open_bundle(&self, _reference: &SceneRef, _files: Vec<SceneFile>) -> Result<Arc<Scene>, String> {
        Ok(self.0.clone())
    }
}

/// A coordinator, one worker and a client in this process.
async fn cluster(machine: &Arc<Machine>, ending: &CancellationToken) -> Client {
    let served = Arc::new(Served(Arc::new(argus_scene::open(SCENE).unwrap())));
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    let registry = Arc::new(LocalRegistry::alone());
    // Samples added for holes would change the frames of the same views.
    let core = core::Config { refining_share: 0.0, ..core::Config::default() };
    let config = coordinator::Config { core, ..coordinator::Config::default() };
    tokio::spawn(coordinator::serve(config, listener, served.clone(), registry, ending.clone()));
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    tokio::spawn(worker::run(worker::Config::new(&url), listener, machine.clone(), served, ending.clone()));
    let connected = async {
        loop {
            match Client::connect(&url).await {
                Ok(client) => return client,
                Err(_) => tokio::time::sleep(Duration::from_millis(20)).await,
            }
        }
    };
    tokio::time::timeout(PATIENCE, connected).await.unwrap()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn views_in_flight_survive_the_loss_of_the_device_with_the_same_image() {
    let machine = Arc::new(Machine::default());
    let ending = CancellationToken::new();
    let client = cluster(&machine, &ending).await;
    let cameras: Vec<_> = client.description().cameras.iter().map(|named| named.camera).collect();
    // From samples, with traced pixels, and directly from triangles: each method has state on the device.
    let plans = [
        PlanRequest::from_samples(),
        PlanRequest { holes: Some(Holes::Trace), ..PlanRequest::default() },
        PlanRequest { direct: true, ..PlanRequest::default() },
    ];
    let views: Vec<View> = (0..plans.len() * 2)
        .map(|i| View::new(cameras[i / plans.len() % cameras.len()], [160, 120], plans[i % plans.len()]))
        .collect();
    let patient = RenderOptions { deadline: PATIENCE, ..RenderOptions::default() };
    let mut whole = Vec::new();
    for view in &views {
        whole.push(client.render(view, &patient).await.unwrap().frame.images[Output::Color].clone().unwrap());
    }
    for losses in 1..=3 {
        let mut answers = JoinSet::new();
        for round in 0..4 {
            for (i, view) in views.iter().cloned().enumerate() {
                let (client, patient) = (client.clone(), patient.clone());
                answers.spawn(async move { (i, round, client.render(&view, &patient).await) });
            }
        }
        // Some views are answered, some in work, some queued.
        let first = answers.join_next().await.unwrap().unwrap();
        first.2.unwrap();
        machine.lose();
        while let Some(answer) = answers.join_next().await {
            let (i, round, answer) = answer.unwrap();
            let frame = answer.unwrap_or_else(|error| panic!("view {i} of round {round}: {error}")).frame;
            assert!(
                frame.images[Output::Color].clone().unwrap() == whole[i],
                "view {i} of round {round} is another one now"
            );
        }
        assert_eq!(machine.opened.load(Ordering::SeqCst), losses + 1, "one device after the other");
    }
    ending.cancel();
}
