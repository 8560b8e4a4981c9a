//! What the planner's choices cost: the same views by default and with each way forced, one at a time.

use std::time::{Duration, Instant};

use anyhow::Result;
use argus_client::{Client, RenderOptions};
use argus_scene::{Camera, Frame, Outputs, View};

use super::Options;
use super::mode::Mode;
use super::predictions::took_ms;
use super::truth::{Judged, Truths};

/// A frame from samples counts as a way within bound where its mean FLIP is above that of the direct view by no more: the
/// bound of requests that state none.
pub(super) const BOUND: f64 = 0.03;

/// A view without a frame for this long has none.
const DEADLINE: Duration = Duration::from_secs(10);

/// Time for the views of all ways together, at most; what is left undone then is left out.
const BUDGET: Duration = Duration::from_secs(90);

/// Time by default over that of the best way within bound.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Regret {
    /// Views that were compared.
    pub(super) views: u64,
    /// Sum of the times by default over the sum of the best times, less one; `None` where nothing was compared.
    pub(super) share: Option<f64>,
}

/// Milliseconds of one view: waiting for its worker's render thread, and rendering.
#[derive(Debug, Clone, Copy)]
struct Times {
    default_ms: f64,
    direct_ms: f64,
    /// Of the frame from samples, where there is one within bound.
    warp_ms: Option<f64>,
}

/// Compares views of the service that it was started for, which should have nothing else to do.
///
/// # Errors
/// A reference that is not rendered.
pub(super) async fn measure(client: &Client, options: &Options, truths: &mut Truths) -> Result<Regret> {
    let until = Instant::now() + BUDGET;
    let mut compared: Vec<(Camera, [Option<Frame>; 3])> = Vec::new();
    // Default and direct in turns, so that both find the same machine, and before forced requests bring further samples.
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
        // Once for its samples, and once to be measured.
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

/// Poses of the walk, evenly spread over the time of a phase and over the clients.
fn poses(client: &Client, options: &Options) -> Vec<Camera> {
    let count = options.regret_views;
    let secs = |k: u32| options.seconds * (f64::from(k) + 0.5) / f64::from(count);
    let pose = |k: u32| options.walk.camera(client.description(), k % options.clients.max(1), secs(k));
    (0..count).map(pose).collect()
}

async fn render(client: &Client, options: &Options, camera: Camera, mode: Mode) -> Option<Frame> {
    let [width, height] = options.size;
    let view = View { camera, width, height, outputs: Outputs::COLOR, plan: mode.plan(), pin: None };
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
    fn regret_is_the_time_over_that_of_the_best_way_of_each_view() {
        let times = |default_ms, direct_ms, warp_ms| Times { default_ms, direct_ms, warp_ms };
        assert_eq!(regret(&[]), Regret { views: 0, share: None });
        let twice = regret(&[times(20.0, 20.0, Some(10.0)), times(20.0, 10.0, None)]);
        assert_eq!(twice, Regret { views: 2, share: Some(1.0) });
        assert_eq!(regret(&[times(8.0, 8.0, Some(9.0))]).share, Some(0.0));
    }
}
