//! The planner's regret: the same views by default and with each method forced, one at a time.

use std::time::{Duration, Instant};

use anyhow::Result;
use argus_client::{Client, RenderOptions};
use argus_scene::{Camera, Frame, View};

use super::mode::Mode;
use super::options::Options;
use super::predictions::took_ms;
use super::truth::{Judged, Truths};

/// Largest excess FLIP over the direct view at which a frame from samples is within bound: the default of requests
/// without a bound.
pub(super) const BOUND: f64 = 0.03;

/// A view without a frame after this time has failed.
const DEADLINE: Duration = Duration::from_secs(10);

/// Time limit for the views of all methods; the rest is skipped.
const BUDGET: Duration = Duration::from_secs(90);

/// Time by default over the time of the best method within bound.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Regret {
    /// Compared views.
    pub(super) views: u64,
    /// Sum of the times by default over the sum of the best times, minus 1; `None` if nothing was compared.
    pub(super) share: Option<f64>,
}

/// Milliseconds of one view: waiting for its worker's render thread, and rendering.
#[derive(Debug, Clone, Copy)]
struct Times {
    default_ms: f64,
    direct_ms: f64,
    /// Time of the frame from samples, if it is within bound.
    warp_ms: Option<f64>,
}

/// Compares views on a service that has nothing else to do.
///
/// # Errors
/// A reference that is not rendered.
pub(super) async fn measure(client: &Client, options: &Options, truths: &mut Truths) -> Result<Regret> {
    let until = Instant::now() + BUDGET;
    let mut compared: Vec<(Camera, [Option<Frame>; 3])> = Vec::new();
    // Default and direct alternate, so that both find the same machine, before forced requests bring further samples.
    for camera in poses(client, options) {
        if Instant::now() + BUDGET / 2 > until {
            break;
        }
        let default = render(client, options, camera, Mode::Default).await;
        let direct = render(client, options, camera, Mode::Direct).await;
        compared.push((camera, [default, direct, None]));
    }
    for (camera, [.., warp]) in &mut compared {
        if Instant::now() > until {
            break;
        }
        // The first request renders the samples; the second is measured.
        if render(client, options, *camera, Mode::Warp).await.is_some() {
            *warp = render(client, options, *camera, Mode::Warp).await;
        }
    }
    let mut times = Vec::new();
    for (camera, frames) in compared {
        let [Some(default), Some(direct), warp] = frames else { continue };
        let (default_ms, direct_ms) = (took_ms(&default), took_ms(&direct));
        let warp_ms = match warp.filter(|frame| took_ms(frame) < direct_ms) {
            Some(frame) => {
                let ms = took_ms(&frame);
                let excess = truths.judge(client, &[Judged { camera, frame }]).await?.excess;
                excess.filter(|excess| *excess <= BOUND).map(|_| ms)
            }
            None => None,
        };
        times.push(Times { default_ms, direct_ms, warp_ms });
    }
    Ok(regret(&times))
}

/// Poses of the walk, evenly spread over a phase and over the clients.
fn poses(client: &Client, options: &Options) -> Vec<Camera> {
    let count = options.regret_views;
    let secs = |k: u32| options.seconds * (f64::from(k) + 0.5) / f64::from(count);
    let pose = |k: u32| options.walk.camera(client.description(), k % options.clients.max(1), secs(k));
    (0..count).map(pose).collect()
}

async fn render(client: &Client, options: &Options, camera: Camera, mode: Mode) -> Option<Frame> {
    let [width, height] = options.size;
    let view = View::new(camera, [width, height], mode.plan());
    let patience = RenderOptions { deadline: DEADLINE, ..RenderOptions::default() };
    client.render(&view, &patience).await.ok().map(|answer| answer.frame)
}

fn regret(times: &[Times]) -> Regret {
    let best = |t: &Times| t.warp_ms.map_or(t.direct_ms, |ms| ms.min(t.direct_ms));
    let (taken, best): (f64, f64) = (times.iter().map(|t| t.default_ms).sum(), times.iter().map(best).sum());
    Regret { views: times.len() as u64, share: (best > 0.0).then(|| taken / best - 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regret_compares_with_the_best_method_of_each_view() {
        let times = |default_ms, direct_ms, warp_ms| Times { default_ms, direct_ms, warp_ms };
        assert_eq!(regret(&[]), Regret { views: 0, share: None });
        let twice = regret(&[times(20.0, 20.0, Some(10.0)), times(20.0, 10.0, None)]);
        assert_eq!(twice, Regret { views: 2, share: Some(1.0) });
        assert_eq!(regret(&[times(8.0, 8.0, Some(9.0))]).share, Some(0.0));
    }
}
