//! Which source is worth rendering for all.
//!
//! Each view that would have gained from a source at its own eye adds what it would have gained to an account: error, and seconds,
//! for each kind of source that could be bought. The account is that of the nearest source, or of the place where none is near. So
//! views that lack the same thing fill the same account. Sums fade within seconds. An account is worth what it gains a second of
//! rendering. The best one is bought once that exceeds what the queue says a second is worth; its source stands at the newest eye that
//! added to it, with a border, so that it serves those who move on from there.

use std::collections::BTreeMap;

use argus_scene::{Camera, FrameSource, Lens, SampleId};
use glam::DVec2;

use crate::core::time::Uptime;

/// Size of a bought source's image plane over that of the view, in each direction.
///
/// Tuned: 1.25; uncovered pixels fall from 9.5 to 4.2% (Sponza) for 1.27 of the time, at 1.5 for 1.55 to 1.75 (CROWD.md).
pub const BORDER: f64 = 1.25;

/// Seconds within which sums fade to a third.
///
/// Tuned: 6 (CROWD.md, rule 4).
const FADE_SECS: f64 = 6.0;

/// Least worth of a purchase, FLIP a second.
///
/// Tuned: .002 (CROWD.md, rule 4).
const LEAST_WORTH: f64 = 0.002;

/// Most accounts; the one of least worth goes first.
const MOST_ACCOUNTS: usize = 512;

/// A kind of source that can be bought, by its samples a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Purchasable {
    /// One sample a pixel: as the views from triangles that it replaces.
    One,
    /// Four: antialiased, for all views that are warped from it.
    Four,
}

impl Purchasable {
    /// All kinds.
    pub const ALL: [Self; 2] = [Self::One, Self::Four];

    /// Its place in [`Self::ALL`].
    pub fn index(self) -> usize {
        self as usize
    }

    /// Samples a pixel.
    pub fn samples_per_pixel(self) -> u32 {
        match self {
            Self::One => 1,
            Self::Four => 4,
        }
    }

    /// Time over that of a view from triangles, before any was bought.
    ///
    /// Tuned: 1.27, 3.55 (CROWD.md).
    pub fn ratio(self) -> f64 {
        match self {
            Self::One => 1.27,
            Self::Four => 3.55,
        }
    }
}

/// The source that stands at a view's eye. `view` is the direct frame that would answer the view.
pub fn eye_sample(view: &FrameSource, kind: Purchasable) -> FrameSource {
    let grown = |side: u32| (f64::from(side) * BORDER).round().min(f64::from(u32::MAX)) as u32;
    let (width, height) = (grown(view.width).max(1), grown(view.height).max(1));
    let camera = with_size(view.camera, [view.width, view.height], [width, height]);
    FrameSource {
        camera,
        width,
        height,
        samples_per_pixel: kind.samples_per_pixel(),
        band_rows: 0,
        light: None,
    }
}

/// A pinhole camera whose image of another size has the same pixels in its middle.
fn with_size(camera: Camera, from: [u32; 2], to: [u32; 2]) -> Camera {
    let [from, to] = [from, to].map(|[x, y]| DVec2::new(f64::from(x), f64::from(y)));
    match camera.lens {
        Some(Lens::Intrinsics(mut intrinsics)) => {
            intrinsics.center += 0.5 * (to - from);
            Camera { lens: Some(Lens::Intrinsics(intrinsics)), ..camera }
        }
        _ => {
            let half = (camera.fov_deg * 0.5).to_radians().tan() * to.y / from.y;
            Camera { fov_deg: 2.0 * half.atan().to_degrees(), ..camera }
        }
    }
}

/// Whose account it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Site {
    /// Of the views around a source.
    Source(SampleId),
    /// Of the views at a place that is near no source.
    Place(u64),
}

/// What a view would have gained from a source of one kind.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Gain {
    /// Mean FLIP.
    pub error: f64,
    /// Seconds of a worker.
    pub secs: f64,
}

/// What views would have gained from one more source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Account {
    /// By [`Purchasable::index`].
    gains: [Gain; Purchasable::ALL.len()],
    at: Uptime,
    /// The newest view that added to it, as the direct frame that would have answered it.
    pub view: FrameSource,
}

impl Account {
    /// What a second of rendering such a source gains, FLIP a second, where a second is worth `price` and it takes `secs`.
    fn worth(&self, kind: Purchasable, price: f64, secs: f64, now: Uptime) -> f64 {
        let gain = self.gains[kind.index()];
        let fades = (-now.since(self.at).as_secs_f64() / FADE_SECS).exp();
        let worth = fades * (gain.error + price * gain.secs) / secs;
        // A price that is not known buys nothing.
        if worth.is_finite() { worth } else { 0.0 }
    }
}

/// All accounts.
#[derive(Debug, Clone, Default)]
pub struct Accounts(BTreeMap<Site, Account>);

/// The best purchase on offer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Purchase {
    /// Its account.
    pub site: Site,
    /// Its kind.
    pub kind: Purchasable,
    /// The newest view that added to the account, as the direct frame that would have answered it.
    pub view: FrameSource,
}

impl Accounts {
    /// Adds what a view would have gained, if it would have gained by any kind where a second is worth `price`.
    pub fn add(&mut self, site: Site, gains: [Gain; 2], view: FrameSource, price: f64, now: Uptime) {
        let gains_by = |gain: &Gain| gain.error + price * gain.secs > 0.0;
        if !gains.iter().any(gains_by) {
            return;
        }
        let account = self.0.entry(site).or_insert(Account { gains: [Gain::default(); 2], at: now, view });
        let fades = (-now.since(account.at).as_secs_f64() / FADE_SECS).exp();
        for (sum, gain) in account.gains.iter_mut().zip(gains) {
            sum.error = (sum.error * fades + gain.error).max(0.0);
            sum.secs = (sum.secs * fades + gain.secs).max(0.0);
        }
        (account.at, account.view) = (now, view);
        if self.0.len() > MOST_ACCOUNTS {
            let sum = |account: &Account| {
                let fades = (-now.since(account.at).as_secs_f64() / FADE_SECS).exp();
                fades * account.gains.iter().map(|gain| gain.error + price * gain.secs).sum::<f64>()
            };
            let least = self.0.iter().min_by(|a, b| sum(a.1).total_cmp(&sum(b.1))).map(|(site, _)| *site);
            least.and_then(|site| self.0.remove(&site));
        }
    }

    /// Ends an account, since its source is bought.
    pub fn end(&mut self, site: Site) {
        self.0.remove(&site);
    }

    /// Ends all accounts.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// Number of accounts.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are no accounts.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// What the best purchase on offer is worth, FLIP a second, and that purchase if it is worth more than a second of the queue.
///
/// `price` is that of the queue. `secs` is how long a source of a kind takes for such a view.
pub fn buy(
    accounts: &Accounts,
    price: f64,
    secs: impl Fn(Purchasable, &FrameSource) -> f64,
    now: Uptime,
) -> (f64, Option<Purchase>) {
    let worth = |account: &Account, kind| account.worth(kind, price, secs(kind, &account.view), now);
    let all = accounts.0.iter().flat_map(|(site, account)| {
        Purchasable::ALL
            .map(|kind| (worth(account, kind), Purchase { site: *site, kind, view: account.view }))
    });
    // Of equal ones the first.
    let best = all.reduce(|best, other| if other.0 > best.0 { other } else { best });
    let Some((worth, purchase)) = best else { return (0.0, None) };
    (worth, (worth > price.max(LEAST_WORTH)).then_some(purchase))
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use argus_scene::Intrinsics;
    use glam::DVec3;

    use super::*;

    fn at(secs: f64) -> Uptime {
        Uptime(Duration::from_secs_f64(secs))
    }

    fn view(x: f64) -> FrameSource {
        let camera = Camera::look_at(DVec3::X * x, DVec3::NEG_Z);
        FrameSource { camera, width: 200, height: 150, samples_per_pixel: 1, band_rows: 0, light: None }
    }

    fn gain(error: f64, secs: f64) -> [Gain; 2] {
        [Gain { error, secs }; 2]
    }

    /// Sources of one and four samples a pixel take .1 and .28 s.
    fn secs(kind: Purchasable, _: &FrameSource) -> f64 {
        [0.1, 0.28][kind.index()]
    }

    #[test]
    fn views_that_lack_the_same_thing_fill_one_account_and_the_newest_eye_gets_the_source() {
        let mut accounts = Accounts::default();
        let site = Site::Place(7);
        (0..5).for_each(|i| accounts.add(site, gain(0.02, 0.0), view(f64::from(i)), 1.0, at(1.0)));
        accounts.add(Site::Place(8), gain(0.03, 0.0), view(9.0), 1.0, at(1.0));
        let (worth, purchase) = buy(&accounts, 0.0, secs, at(1.0));
        let purchase = purchase.unwrap();
        assert!((worth - 1.0).abs() < 1e-9);
        assert_eq!((purchase.site, purchase.kind, purchase.view), (site, Purchasable::One, view(4.0)));
        accounts.end(site);
        assert_eq!(buy(&accounts, 0.0, secs, at(1.0)).1.unwrap().site, Site::Place(8));
    }

    #[test]
    fn nothing_is_bought_that_is_worth_less_than_a_second_of_the_queue() {
        let mut accounts = Accounts::default();
        accounts.add(Site::Place(1), gain(0.02, 0.0), view(0.0), 1.0, at(0.0));
        assert!(buy(&accounts, 0.19, secs, at(0.0)).1.is_some());
        let (worth, purchase) = buy(&accounts, 0.21, secs, at(0.0));
        assert!((worth - 0.2).abs() < 1e-9 && purchase.is_none());
        // Seconds that it saves are worth the queue's price.
        accounts.add(Site::Place(1), gain(0.0, 0.2), view(0.0), 1.0, at(0.0));
        assert!(buy(&accounts, 0.21, secs, at(0.0)).1.is_some());
    }

    #[test]
    fn accounts_fade_and_end_with_their_purchase() {
        let mut accounts = Accounts::default();
        accounts.add(Site::Place(1), gain(0.02, 0.0), view(0.0), 1.0, at(0.0));
        assert!(buy(&accounts, 0.0, secs, at(6.0)).0 < 0.08);
        assert!(buy(&accounts, 0.0, secs, at(60.0)).1.is_none());
        accounts.end(Site::Place(1));
        assert_eq!((accounts.len(), buy(&accounts, 0.0, secs, at(0.0))), (0, (0.0, None)));
    }

    #[test]
    fn views_that_gain_nothing_open_no_account_and_losses_never_make_debts() {
        let mut accounts = Accounts::default();
        accounts.add(Site::Place(1), gain(-0.01, 0.0), view(0.0), 1.0, at(0.0));
        accounts.add(Site::Place(1), gain(f64::NAN, 0.0), view(0.0), 1.0, at(0.0));
        assert!(accounts.is_empty());
        let mixed = [Gain { error: -0.01, secs: 0.0 }, Gain { error: 0.01, secs: 0.0 }];
        (0..9).for_each(|_| accounts.add(Site::Place(1), mixed, view(0.0), 1.0, at(0.0)));
        assert_eq!(buy(&accounts, 0.0, secs, at(0.0)).1.unwrap().kind, Purchasable::Four);
    }

    #[test]
    fn accounts_are_bounded_and_the_least_worth_goes_first() {
        let mut accounts = Accounts::default();
        for i in 0..=MOST_ACCOUNTS as u64 {
            let error = if i == 3 { 1e-6 } else { 0.01 };
            accounts.add(Site::Place(i), gain(error, 0.0), view(0.0), 1.0, at(0.0));
        }
        assert_eq!(accounts.len(), MOST_ACCOUNTS);
        assert!(!accounts.0.contains_key(&Site::Place(3)));
    }

    #[test]
    fn prices_that_are_not_known_buy_nothing() {
        let mut accounts = Accounts::default();
        accounts.add(Site::Place(1), gain(0.02, 0.0), view(0.0), 1.0, at(0.0));
        for odd in [0.0, f64::NAN] {
            assert!(buy(&accounts, 0.0, |_, _| odd, at(0.0)).1.is_none());
        }
    }

    #[test]
    fn the_middle_of_a_source_has_the_pixels_of_the_view() {
        let lens = Lens::Intrinsics(Intrinsics::pinhole(DVec2::new(180.0, 181.0), DVec2::new(90.0, 80.0)));
        for camera in [view(1.0).camera, Camera { lens: Some(lens), ..view(1.0).camera }] {
            let view = FrameSource { camera, ..view(1.0) };
            let source = eye_sample(&view, Purchasable::Four);
            assert_eq!((source.width, source.height, source.samples_per_pixel), (250, 188, 4));
            let offset = DVec2::new(25.0, 19.0);
            for pixel in [DVec2::ZERO, DVec2::new(200.0, 150.0), DVec2::new(17.0, 99.0)] {
                let a = view.camera.direction(pixel, view.width, view.height);
                let b = source.camera.direction(pixel + offset, source.width, source.height);
                assert!(a.distance(b) < 1e-9, "{a} {b}");
            }
        }
    }
}
