//! Loads beyond the capacity of direct views: the default's share of the best forced method's rate.

use std::path::Path;
use std::time::Duration;

use anyhow::{Context as _, Result};
use argus_client::load::burst;
use argus_client::{Client, RenderOptions};
use argus_local::{LocalCluster, settle};
use argus_scene::View;
use indicatif::ProgressBar;

use super::mode::{Mode, Phase};
use super::options::Options;
use super::phase::{Load, connect, of_phase};
use super::regret::BOUND;
use super::row::Measured;
use super::truth::Truths;

/// Views of the first burst, which estimates the rate of the second.
const FIRST: u32 = 16;
/// Most views of the second burst, so that it takes no longer than a phase.
const MOST: u32 = 4000;
/// Views in flight per worker: enough that no worker runs out of them.
const IN_FLIGHT: usize = 8;
/// A view without a frame after this time has failed. A longer deadline would prolong the phase for late views.
const DEADLINE: Duration = Duration::from_secs(10);
/// Largest difference of excess FLIP between frames of equal error.
const SAME_ERROR: f64 = 0.005;

/// The modes, forced ones first; each has its own cluster.
const ORDER: [Mode; 3] = [Mode::Direct, Mode::Warp, Mode::Default];

/// Runs both overloads of all modes; `progress` counts them.
pub(super) async fn run(
    argus: &Path,
    options: &Options,
    truths: &mut Truths,
    progress: &ProgressBar,
) -> Result<Vec<(Mode, Phase, Measured)>> {
    let (mut all, mut carried) = (Vec::new(), 0.0);
    for mode in ORDER {
        let say = |what: &str| progress.set_message(format!("{}: {what}", mode.name()));
        say("warming up for overload");
        let cluster = LocalCluster::start(argus, &options.scene, options.workers, &options.serve)?;
        let client = connect(&cluster, options).await?;
        let patience = Duration::try_from_secs_f64(options.settle_secs)?;
        of_phase(&client, options, mode, Load::of(options)).await?;
        settle(&client, options.workers, patience).await?;
        if mode == Mode::Direct {
            carried = peak(&client, options, mode).await.context("the load that direct views carry")?;
        }
        for (phase, times) in [(Phase::Twice, 2.0), (Phase::Fourfold, 4.0)] {
            say(phase.name());
            let rate = times * carried / f64::from(options.clients.max(1));
            let (mut measured, views) =
                of_phase(&client, options, mode, Load { rate, deadline: DEADLINE }).await?;
            settle(&client, options.workers, patience).await?;
            measured.errors = truths.judge(&client, &views.judged).await?;
            measured.offered_per_sec = Some(times * carried);
            all.push((mode, phase, measured));
            progress.inc(1);
        }
        drop(client);
        cluster.stop()?;
    }
    state_shares(&mut all);
    Ok(all)
}

/// Views answered per second when there is always a next one.
async fn peak(client: &Client, options: &Options, mode: Mode) -> Result<f64> {
    let ([width, height], walk, clients) = (options.size, options.walk, options.clients.max(1));
    let patience = RenderOptions { deadline: DEADLINE, ..RenderOptions::default() };
    let mut views_per_sec = 0.0;
    let mut count = FIRST;
    for _ in 0..2 {
        let view = |k: u32| {
            let secs = options.seconds * f64::from(k) / f64::from(count);
            let camera = walk.camera(client.description(), k % clients, secs);
            View::new(camera, [width, height], mode.plan())
        };
        let views = (0..count).map(view).collect();
        let outcome = burst(client, views, IN_FLIGHT * options.workers, &patience, |_, _| ()).await;
        if let Some(error) = outcome.first_error.filter(|_| outcome.failed == outcome.views) {
            anyhow::bail!("no view was answered: {error}");
        }
        views_per_sec = outcome.views_per_sec;
        count = ((views_per_sec * options.seconds) as u32).clamp(FIRST, MOST);
    }
    Ok(views_per_sec)
}

/// Sets each phase's share of the highest rate of a forced method, in either overload, whose frames are within bound
/// or have about the same error.
fn state_shares(all: &mut [(Mode, Phase, Measured)]) {
    let forced: Vec<(f64, f64)> = all
        .iter()
        .filter(|(mode, ..)| *mode != Mode::Default)
        .filter_map(|(.., m)| Some((m.errors.excess?, m.views_per_sec)))
        .collect();
    for (.., measured) in all {
        let excess = measured.errors.excess.map_or(BOUND, |excess| (excess + SAME_ERROR).max(BOUND));
        let alike = forced.iter().filter(|(of, _)| *of <= excess);
        let best = alike.map(|(_, views_per_sec)| *views_per_sec).fold(0.0, f64::max);
        measured.share_of_peak = (best > 0.0).then(|| measured.views_per_sec / best);
    }
}

#[cfg(test)]
mod tests {
    use super::super::truth::Errors;
    use super::*;

    #[test]
    fn the_share_compares_with_the_best_forced_method_of_equal_error() {
        let row = |mode, views_per_sec, excess| {
            let errors = Errors { excess: Some(excess), ..Errors::default() };
            (mode, Phase::Twice, Measured { views_per_sec, errors, ..Measured::default() })
        };
        let mut all =
            [row(Mode::Direct, 50.0, 0.0), row(Mode::Warp, 200.0, 0.1), row(Mode::Default, 45.0, 0.01)];
        state_shares(&mut all);
        assert_eq!(all[2].2.share_of_peak, Some(0.9), "the faster method is not as good");
        all[2].2.errors.excess = Some(0.1);
        state_shares(&mut all);
        assert_eq!(all[2].2.share_of_peak, Some(0.225));
        let mut none = [row(Mode::Default, 45.0, 0.0)];
        state_shares(&mut none);
        assert_eq!(none[0].2.share_of_peak, None);
    }
}
