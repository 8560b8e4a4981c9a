//! The connection to a service, and batches of views.

use std::time::Duration;

use argus_client::{
    Batch, ClientError, ConnectOptions, Credentials, Encoding, FrameMeta, Key, RenderOptions, SessionOptions,
    Token,
};
use argus_scene::{Frame, Lens, PlanRequest, Provenance, RayList, View};
use futures::StreamExt;
use futures::stream::BoxStream;
use glam::Vec3;
use numpy::{PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use serde_json::Value;
use tokio::time::timeout;

use crate::error::{exception, invalid};
use crate::images::{self, Array, Images};
use crate::report::{self, Report};
use crate::runtime::Home;
use crate::session::Session;
use crate::transforms::{self, NodeKey};
use crate::wanted::{LensRow, Wanted, camera};

/// Most cameras of one request.
const MOST_CAMERAS: usize = 2048;
/// Single views that are in flight at once.
const AT_ONCE: usize = 16;

/// A frame, or why there is none.
type Arrived = Result<(Frame, FrameMeta), ClientError>;

/// A connection to a service. Threads may share it.
#[pyclass(frozen, module = "argus_render._native")]
pub(crate) struct Client {
    client: argus_client::Client,
    encoding: Encoding,
    home: Home,
}

#[pymethods]
impl Client {
    /// Connects, within `timeout` seconds. Certificates and keys are PEM; `identity` is a certificate and its key. `scene` is the name of
    /// one of the service's scenes, else the first one.
    #[new]
    #[pyo3(signature = (url, *, encoding, timeout, ca, token, identity, scene))]
    #[allow(clippy::too_many_arguments, reason = "the package alone calls it, with all of them")]
    fn new(
        py: Python<'_>,
        url: &str,
        encoding: &str,
        timeout: f64,
        ca: Option<Vec<u8>>,
        token: Option<&str>,
        identity: Option<(Vec<u8>, Vec<u8>)>,
        scene: Option<String>,
    ) -> PyResult<Self> {
        let encoding = match encoding {
            "raw" => Encoding::Raw,
            "zstd" => Encoding::Zstd,
            other => return Err(invalid(py, "encoding", format!("{other:?} is neither raw nor zstd"))),
        };
        let token = token.map(Token::parse).transpose().map_err(|reason| invalid(py, "token", reason))?;
        let identity = identity.map(|(certificate, key)| (certificate, Key(key)));
        let credentials = Credentials { ca, token, identity };
        let options =
            ConnectOptions { timeout: secs(py, timeout)?, credentials, scene, ..ConnectOptions::default() };
        let home = Home::here()?;
        let connected = home.wait(py, argus_client::Client::connect_with(url, &options))?;
        Ok(Self { client: connected.map_err(|error| exception(py, &error))?, encoding, home })
    }

    /// The served scene, as JSON.
    fn describe(&self, py: Python<'_>) -> PyResult<String> {
        let described = self.home.wait(py, self.client.describe())?;
        described.map(|description| report::of_service(&description)).map_err(|error| exception(py, &error))
    }

    /// The names of the scene's instances or materials, by their ids.
    fn names(&self, py: Python<'_>, output: &str) -> PyResult<Vec<String>> {
        let output = images::named(py, output)?;
        self.home.wait(py, self.client.names(output))?.map_err(|error| exception(py, &error))
    }

    /// The names of the scene's nodes, by their indices.
    fn node_names(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.home.wait(py, self.client.node_names())?.map_err(|error| exception(py, &error))
    }

    /// Sets the transforms of nodes, each of 12 numbers row by row or none for that of the file. Returns the new state as JSON.
    fn set_transforms(
        &self,
        py: Python<'_>,
        nodes: Vec<NodeKey>,
        matrices: Vec<Option<Vec<f64>>>,
        world: bool,
        expected_revision: Option<u64>,
    ) -> PyResult<String> {
        let sets = transforms::sets(py, nodes, matrices, world)?;
        let moved = self.home.wait(py, self.client.set_transforms(&sets, expected_revision))?;
        moved.map(|moved| transforms::report(&moved)).map_err(|error| exception(py, &error))
    }

    /// Who set each node last: index, revision, client.
    fn node_setters(&self, py: Python<'_>) -> PyResult<Vec<(u32, u64, String)>> {
        let setters =
            self.home.wait(py, self.client.node_setters())?.map_err(|error| exception(py, &error))?;
        Ok(setters.into_iter().map(|by| (by.node, by.revision, by.client)).collect())
    }

    /// Renders a view of each pose (rows of eye, direction and up) and writes its images into the caller's arrays.
    /// Returns each frame's report as JSON, or its exception. `flow_to`: the poses that flow leads to, else none. `rays`: for each
    /// pose the directions of its pixels in world axes, else none.
    /// `timeout`: the longest wait for the next frame, seconds.
    #[allow(clippy::too_many_arguments, reason = "the package alone calls it, with all of them")]
    fn render<'py>(
        &self,
        py: Python<'py>,
        poses: PyReadonlyArray2<'py, f64>,
        lenses: Vec<LensRow>,
        flow_to: Option<PyReadonlyArray2<'py, f64>>,
        rays: Option<PyReadonlyArray3<'py, f32>>,
        size: (u32, u32),
        mut arrays: Vec<Array<'py>>,
        plan: &str,
        timeout: f64,
    ) -> PyResult<Vec<Py<PyAny>>> {
        let wanted = Wanted::of(py, size, arrays.iter().map(|(name, _)| name), plan)?;
        let mut views = Vec::new();
        for camera in cameras(py, &poses, &lenses)? {
            views.push(wanted.view(camera));
        }
        if let Some(flow_to) = &flow_to {
            for (view, camera) in views.iter_mut().zip(cameras(py, flow_to, &lenses)?) {
                // As a batch: a plan that leaves the way open is fixed.
                view.plan.direct |= view.plan.leaves_way_open();
                view.flow_to = Some(camera);
            }
        }
        if let Some(rays) = &rays {
            for (view, directions) in views.iter_mut().zip(rays.as_array().outer_iter()) {
                let directions =
                    directions.rows().into_iter().map(|at| Vec3::new(at[0], at[1], at[2])).collect();
                let list = RayList::new(directions).map_err(|at| invalid(py, at.field, at.reason))?;
                view.camera.lens = Some(Lens::Rays { spacing_deg: list.spacing_deg(view.width) });
                view.rays = Some(list);
                view.plan.direct = true;
            }
        }
        self.rendered(py, views, &mut arrays, timeout)
    }

    /// Makes the frame of a record again, by any device, and writes its images into the caller's arrays.
    fn replay<'py>(
        &self,
        py: Python<'py>,
        record: &str,
        mut arrays: Vec<Array<'py>>,
        timeout: f64,
    ) -> PyResult<Py<PyAny>> {
        let view = recorded(py, record)?;
        let made = self.rendered(py, vec![view], &mut arrays, timeout)?;
        made.into_iter().next().ok_or_else(|| invalid(py, "record", "has no frame"))
    }

    /// A session of a moving camera.
    fn session(
        &self,
        py: Python<'_>,
        size: (u32, u32),
        outputs: Vec<String>,
        plan: &str,
        history: bool,
    ) -> PyResult<Session> {
        self.home.check(py)?;
        let wanted = Wanted::of(py, size, &outputs, plan)?;
        let options = SessionOptions { encoding: self.encoding, history, ..SessionOptions::default() };
        Ok(Session::begin(self.client.session(options), wanted, self.client.description().limits, self.home))
    }
}

impl Client {
    /// Each frame's report, or its exception.
    fn rendered(
        &self,
        py: Python<'_>,
        views: Vec<View>,
        arrays: &mut [Array<'_>],
        timeout: f64,
    ) -> PyResult<Vec<Py<PyAny>>> {
        let longest = secs(py, timeout)?;
        let pixels = views.first().map_or(0, |view| view.width as usize * view.height as usize);
        let images = Images::of(py, arrays, views.len(), pixels)?;
        let ended = self.home.wait(py, self.receive(views, images, longest))?;
        let said = |frame: Result<String, ClientError>| match frame {
            Ok(report) => Ok(report.into_pyobject(py)?.into_any().unbind()),
            Err(error) => Ok(exception(py, &error).into_value(py).into_any()),
        };
        ended.into_iter().map(said).collect()
    }

    /// The report or the error of each frame, whose images are copied as they come.
    async fn receive(
        &self,
        views: Vec<View>,
        mut images: Vec<Images<'_>>,
        longest: Duration,
    ) -> Vec<Result<String, ClientError>> {
        let late = || ClientError::Deadline { after: longest, last: "no frame came in this time".to_owned() };
        let mut ended: Vec<Result<String, ClientError>> = views.iter().map(|_| Err(late())).collect();
        let scene = &self.client.description().scene_name;
        for (part, views) in views.chunks(MOST_CAMERAS).enumerate() {
            let mut frames = self.frames(views, longest);
            loop {
                match timeout(longest, frames.next()).await {
                    Ok(Some((index, frame))) => {
                        let (at, view) = (part * MOST_CAMERAS + index, &views[index]);
                        ended[at] = frame.and_then(|(frame, meta)| {
                            images::copy(&mut images, at, &frame)?;
                            Report::of(&frame, &meta).with_record(view, scene).text()
                        });
                    }
                    Ok(None) => break,
                    Err(_) => return ended,
                }
            }
        }
        ended
    }

    /// The frames of views of one size, outputs and plan, as they are done: one batch, or single views if they have what a batch
    /// has not.
    fn frames<'a>(&'a self, views: &'a [View], longest: Duration) -> BoxStream<'a, (usize, Arrived)> {
        let Some(&View { width, height, outputs, plan, .. }) = views.first() else {
            return futures::stream::empty().boxed();
        };
        if views.iter().all(|view| view.pin.is_none() && view.flow_to.is_none() && view.rays.is_none()) {
            let cameras = views.iter().map(|view| view.camera).collect();
            return self
                .client
                .render_batch(Batch { cameras, width, height, outputs, plan }, self.encoding)
                .boxed();
        }
        let options =
            RenderOptions { deadline: longest, encoding: self.encoding, ..RenderOptions::default() };
        let one = move |(index, view): (usize, &'a View)| {
            let options = options.clone();
            async move {
                let answer = self.client.render(view, &options).await;
                (index, answer.map(|answer| (answer.frame, answer.meta)))
            }
        };
        futures::stream::iter(views.iter().enumerate()).map(one).buffer_unordered(AT_ONCE).boxed()
    }
}

/// The cameras of rows of poses, each with its lens.
fn cameras(
    py: Python<'_>,
    poses: &PyReadonlyArray2<'_, f64>,
    lenses: &[LensRow],
) -> PyResult<Vec<argus_scene::Camera>> {
    let (rows, rest) = poses.as_slice().map(|numbers| numbers.as_chunks::<9>()).unwrap_or_default();
    if rows.len() != lenses.len() || rows.is_empty() || !rest.is_empty() {
        let reason = format!("must be {} rows of 9 numbers without gaps", lenses.len());
        return Err(invalid(py, "poses", reason));
    }
    rows.iter().zip(lenses).map(|(pose, lens)| camera(py, pose, lens)).collect()
}

/// The view of a record, by any device.
fn recorded(py: Python<'_>, record: &str) -> PyResult<View> {
    let fields: Value =
        serde_json::from_str(record).map_err(|error| invalid(py, "record", error.to_string()))?;
    let wrong =
        |name: &str, error: serde_json::Error| invalid(py, &format!("record.{name}"), error.to_string());
    macro_rules! field {
        ($name:literal) => {
            serde_json::from_value(fields[$name].clone()).map_err(|error| wrong($name, error))?
        };
    }
    let pin = Provenance { device: String::new(), ..field!("provenance") };
    Ok(View {
        camera: field!("camera"),
        width: field!("width"),
        height: field!("height"),
        outputs: field!("outputs"),
        plan: PlanRequest::default(),
        pin: Some(pin),
        flow_to: field!("flow_to"),
        rays: field!("rays"),
    })
}

/// A time of the caller.
///
/// # Errors
/// `InvalidField` unless it is above 0 and finite.
pub(crate) fn secs(py: Python<'_>, timeout: f64) -> PyResult<Duration> {
    let duration = Duration::try_from_secs_f64(timeout).ok().filter(|duration| !duration.is_zero());
    duration.ok_or_else(|| invalid(py, "timeout", format!("must be seconds above 0, not {timeout}")))
}
