use super::*;

const DT: Duration = Duration::from_millis(100);

fn versions() -> Versions {
    Versions::new(Version::default(), Some(DT), Duration::from_secs(1), Duration::from_secs(5))
}

/// The epochs of prepared versions, with their cameras.
fn prepared(versions: &Versions) -> Vec<(u64, u64)> {
    versions.prepared().map(|(version, camera)| (version.state.epoch, camera)).collect()
}

fn ms(ms: u64) -> Uptime {
    Uptime(Duration::from_millis(ms))
}

#[test]
fn a_still_scene_has_one_epoch() {
    let mut still = Versions::new(Version::default(), None, Duration::from_secs(1), Duration::from_secs(5));
    still.used([1, 2], ms(0));
    assert!(!still.wake(ms(5000)));
    assert_eq!(still.advance((ms(10_000), LightLevel::Full), [], |_, _| true, |_, _| false), (false, 0));
    assert_eq!((still.served().state.epoch, still.prepared().count()), (0, 0));
    assert_eq!(
        Versions::new(Version::default(), Some(Duration::ZERO), DT, DT).advance(
            (ms(10_000), LightLevel::Full),
            [],
            |_, _| true,
            |_, _| false
        ),
        (false, 0)
    );
}

#[test]
fn an_epoch_is_served_once_all_of_its_samples_exist() {
    let mut versions = versions();
    versions.used([7, 9], ms(0));
    assert_eq!(
        versions.advance((ms(99), LightLevel::Full), [], |_, _| false, |_, _| false),
        (false, 0),
        "the time of the epoch has not come"
    );
    assert_eq!(versions.advance((ms(100), LightLevel::Full), [], |_, _| false, |_, _| false), (true, 2));
    assert_eq!(prepared(&versions), [(1, 7), (1, 9)]);
    assert_eq!(
        versions.advance(
            (ms(140), LightLevel::Full),
            [],
            |v, camera| (v.state.epoch, camera) == (1, 7),
            |_, _| false
        ),
        (false, 0)
    );
    assert_eq!(versions.served().state.epoch, 0);
    assert_eq!(
        versions.advance((ms(150), LightLevel::Full), [], |v, _| v.state.epoch == 1, |_, _| false),
        (true, 0)
    );
    assert_eq!((versions.served().state.epoch, versions.oldest().state.epoch), (1, 0));
    assert_eq!(
        versions.advance((ms(199), LightLevel::Full), [], |_, _| true, |_, _| false),
        (false, 0),
        "no sooner than Δt after the last"
    );
    assert_eq!(versions.advance((ms(200), LightLevel::Full), [3], |_, _| false, |_, _| false), (true, 3));
    let kept = [(1, 7), (1, 9), (2, 3), (2, 7), (2, 9)];
    assert_eq!(prepared(&versions), kept, "the served epoch's stay");
}

#[test]
fn slow_samplers_make_motion_coarser_and_not_slower() {
    let mut versions = versions();
    let mut served = Vec::new();
    for now in (0..4000).step_by(10) {
        versions.used([1], ms(now));
        // A sample takes 700 ms.
        let issued = versions.issued;
        if versions
            .advance(
                (ms(now), LightLevel::Full),
                [],
                |_, _| ms(now).since(issued) >= Duration::from_millis(700),
                |_, _| false,
            )
            .0
        {
            served.push((now, versions.served().state.epoch));
        }
    }
    served.dedup_by_key(|(_, epoch)| *epoch);
    for (now, epoch) in &served[1..] {
        let late = now - epoch * 100;
        assert!((700..=810).contains(&late), "epoch {epoch} is served at {now} ms");
    }
    assert!(served.len() >= 5, "{served:?}");
}

#[test]
fn while_one_epoch_is_distributed_only_the_next_is_rendered() {
    let mut versions = versions();
    versions.used([1], ms(0));
    assert_eq!(versions.advance((ms(100), LightLevel::Full), [], |_, _| false, |_, _| false), (true, 1));
    assert_eq!(
        versions.advance((ms(250), LightLevel::Full), [], |_, _| false, |_, _| false),
        (false, 0),
        "it is being rendered"
    );
    assert_eq!(
        versions.advance((ms(260), LightLevel::Full), [], |_, _| false, |_, _| true),
        (true, 1),
        "and now on its way"
    );
    assert_eq!(versions.advance((ms(400), LightLevel::Full), [], |_, _| false, |_, _| true), (false, 0));
    assert_eq!(prepared(&versions), [(1, 1), (2, 1)]);
    assert!(versions.advance((ms(450), LightLevel::Full), [], |v, _| v.state.epoch == 1, |_, _| false).0);
    assert_eq!((versions.served().state.epoch, versions.oldest().state.epoch), (1, 0));
}

#[test]
fn an_epoch_per_number_of_plans_is_issued_after_that_number() {
    let mut versions = versions().with_plans(3);
    versions.used([1], ms(100));
    versions.used([1], ms(200));
    assert_eq!(
        versions.advance((ms(300), LightLevel::Full), [], |_, _| true, |_, _| true),
        (true, 1),
        "the first one before any view"
    );
    assert_eq!(
        versions.advance((ms(420), LightLevel::Full), [], |_, _| true, |_, _| true),
        (true, 0),
        "two plans: none is issued"
    );
    versions.used([1], ms(430));
    assert_eq!(versions.advance((ms(440), LightLevel::Full), [], |_, _| true, |_, _| true), (true, 1));
    assert_eq!(versions.advance((ms(600), LightLevel::Full), [], |_, _| true, |_, _| true), (true, 0));
    (0..30).for_each(|i| versions.used([1], ms(600 + i)));
    assert_eq!(versions.advance((ms(700), LightLevel::Full), [], |_, _| true, |_, _| true), (true, 1));
    // Of nine missed epochs, one is made up for.
    let issued = (0..20)
        .filter(|i| {
            versions.advance((ms(750 + i * 20), LightLevel::Full), [], |_, _| true, |_, _| true).1 > 0
        })
        .count();
    assert_eq!(issued, 1);
}

#[test]
fn new_viewpoints_do_not_hold_an_epoch_up() {
    let mut versions = versions();
    versions.used([0], ms(0));
    let mut changes = 0;
    for now in (100..3000).step_by(50) {
        versions.used([now], ms(now));
        // The samples wanted at the time of issue exist 50 ms later; later ones never do.
        changes += u64::from(
            versions
                .advance(
                    (ms(now), LightLevel::Full),
                    [],
                    |v, camera| camera <= v.state.epoch * 100,
                    |_, _| false,
                )
                .0,
        );
    }
    assert!(
        changes > 25 && versions.served().state.epoch >= 27,
        "{changes}, epoch {}",
        versions.served().state.epoch
    );
}

#[test]
fn an_epoch_whose_samples_never_come_is_served_when_patience_ends() {
    let mut versions = versions();
    versions.used([1, 2], ms(0));
    versions.advance((ms(100), LightLevel::Full), [], |_, _| false, |_, _| false);
    assert_eq!(
        versions.advance((ms(4000), LightLevel::Full), [], |_, camera| camera == 1, |_, _| false),
        (false, 0)
    );
    assert_eq!(
        versions.advance((ms(8900), LightLevel::Full), [], |_, camera| camera == 1, |_, _| false),
        (false, 0),
        "one came at 4 s"
    );
    assert!(versions.advance((ms(9000), LightLevel::Full), [], |_, camera| camera == 1, |_, _| false).0);
    assert_eq!((versions.served().state.epoch, versions.oldest().state.epoch), (1, 0));
}

#[test]
fn without_views_no_epoch_is_issued_and_the_next_view_starts_one() {
    let mut versions = versions();
    assert_eq!(versions.advance((ms(700), LightLevel::Full), [], |_, _| true, |_, _| false), (false, 0));
    assert!(versions.wake(ms(750)));
    assert_eq!(versions.served().state.epoch, 7);
    versions.used([1], ms(750));
    assert!(!versions.wake(ms(790)), "a view came just now");
    assert_eq!(versions.advance((ms(850), LightLevel::Full), [], |_, _| true, |_, _| false), (true, 1));
    assert_eq!(versions.advance((ms(900), LightLevel::Full), [], |_, _| true, |_, _| false), (true, 0));
    assert_eq!(versions.served().state.epoch, 8);
    assert_eq!(
        versions.advance((ms(1800), LightLevel::Full), [], |_, _| true, |_, _| false),
        (false, 0),
        "the last view was a second ago"
    );
    assert!(versions.wake(ms(60_050)));
    assert_eq!((versions.served().state.epoch, versions.oldest().state.epoch), (600, 8));
}

#[test]
fn a_new_version_of_the_same_state_is_served_at_once() {
    let mut still = Versions::new(Version::default(), None, Duration::from_secs(1), Duration::from_secs(5));
    still.renew();
    assert_eq!((still.served(), still.oldest()), (Version::of_epoch(1, 0), Version::of_epoch(1, 0)));
    assert_eq!(still.live(), [Version::of_epoch(1, 0)], "older samples cannot be rendered again");

    let mut moving = versions();
    moving.used([7], ms(0));
    assert!(moving.advance((ms(100), LightLevel::Full), [], |_, _| false, |_, _| true).0);
    assert!(moving.advance((ms(200), LightLevel::Full), [], |_, _| true, |_, _| false).0);
    let served = moving.served();
    moving.renew();
    assert_eq!(moving.served().state, served.state);
    assert!(moving.served().number > served.number, "{:?}", moving.served());
    let cameras: BTreeSet<u64> = moving.prepared().map(|(_, camera)| camera).collect();
    assert_eq!(cameras, BTreeSet::from([7]), "it is got ready for the same cameras");
    // Numbers ascend, whatever the versions show.
    moving.used([7], ms(300));
    assert!(moving.advance((ms(400), LightLevel::Full), [], |_, _| false, |_, _| false).0);
    let numbers: Vec<u64> = moving.live().iter().map(|version| version.number).collect();
    assert!(numbers.is_sorted_by(|a, b| a < b), "{numbers:?}");
}

#[test]
fn better_light_is_a_version_that_is_served_once_its_samples_exist() {
    let first =
        Version { number: 0, state: SceneState { light: LightLevel::Direct, ..SceneState::default() } };
    let mut still = Versions::new(first, None, Duration::from_secs(1), Duration::from_secs(5));
    let served = |versions: &Versions| (versions.served().number, versions.served().state.light);
    assert!(still.changes());
    assert_eq!(still.advance((ms(10), LightLevel::Direct), [3], |_, _| false, |_, _| false), (false, 0));
    assert_eq!(still.advance((ms(20), LightLevel::Coarse), [3, 4], |_, _| false, |_, _| false), (true, 2));
    assert_eq!(prepared(&still), [(0, 3), (0, 4)]);
    assert_eq!(served(&still), (0, LightLevel::Direct), "its samples are being rendered");
    // Full light is ready meanwhile.
    assert_eq!(still.advance((ms(30), LightLevel::Full), [3], |_, _| false, |_, _| false), (false, 0));
    assert_eq!(still.advance((ms(40), LightLevel::Full), [], |_, _| true, |_, _| true), (true, 0));
    assert_eq!(served(&still), (1, LightLevel::Coarse));
    assert_eq!(still.advance((ms(41), LightLevel::Full), [], |_, _| true, |_, _| true), (true, 0));
    assert_eq!(served(&still), (2, LightLevel::Full), "no camera is in use");
    assert!(!still.changes(), "no better light will come");
    assert_eq!(still.advance((ms(50), LightLevel::Full), [3], |_, _| true, |_, _| true), (false, 0));
}

#[test]
fn light_that_is_ready_at_once_skips_the_coarse_version() {
    let first =
        Version { number: 0, state: SceneState { light: LightLevel::Direct, ..SceneState::default() } };
    let mut still = Versions::new(first, None, Duration::from_secs(1), Duration::from_secs(5));
    still.advance((ms(10), LightLevel::Full), [], |_, _| false, |_, _| false);
    still.advance((ms(20), LightLevel::Full), [], |_, _| false, |_, _| false);
    assert_eq!(still.served().state.light, LightLevel::Full);
    assert_eq!(still.served().number, 2, "full light has its number even if coarse light was skipped");
}

#[test]
fn light_that_begins_coarse_stays_so() {
    let first =
        Version { number: 0, state: SceneState { light: LightLevel::Coarse, ..SceneState::default() } };
    for every in [None, Some(DT)] {
        let mut versions = Versions::new(first, every, Duration::from_secs(1), Duration::from_secs(5));
        versions.used([1], ms(0));
        versions.advance((ms(500), LightLevel::Full), [], |_, _| true, |_, _| true);
        versions.advance((ms(600), LightLevel::Full), [], |_, _| true, |_, _| true);
        assert_eq!(versions.served().state.light, LightLevel::Coarse);
        assert_eq!(versions.changes(), every.is_some());
    }
}
