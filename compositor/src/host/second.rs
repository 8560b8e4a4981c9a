//! `shaders/compositor/second_pass.wgsl` and `shaders/shared/march.wgsl`: pixels that the warp did not settle with its one frame.
//! They are looked up in all frames at the depths splatted nearby; then they are sky if the frames see past every point of their
//! ray; the others are searched along the ray.

use super::lookup::{
    Depth, Fetches, LANES, SETTLED, depth_of, depth_of_cell, dot3, farther, fetch, splat, splat3,
};
use super::source::HostFrame;
use super::view::{OTHER_SAMPLE, Pixel, UNRESOLVED, View};

/// Steps of the search along a ray, and into how many parts the last is divided.
const STEPS_ALONG: u32 = 64;
const PARTS: f32 = 8.0;
/// Points that are tested at once.
const POINTS: u32 = LANES as u32;

/// The best fetch of all frames for one depth; nothing if no frame looks there.
struct Found {
    fetch: Option<Fetches>,
    source: usize,
    /// Some frame has the surface at its nearest texel, and no frame sees past it.
    settled: bool,
}

/// Looks up a depth in all frames. A frame that sees past the point refutes all others.
#[inline(always)]
fn look_up(view: &View<'_>, d: [f32; 3], q: f32) -> Found {
    let mut best: Option<Fetches> = None;
    let (mut source, mut refuted) = (0, false);
    for i in 0..view.sources.len() {
        let next = fetch(view, i, &splat3(d), &splat(q));
        let sees = |fetch: &Fetches| fetch.agreement[0] >= SETTLED && fetch.is_fine(view, 0);
        let is_better = match &best {
            None => next.inside[0],
            Some(so_far) => {
                let agrees_more = next.agreement[0] > so_far.agreement[0] && so_far.agreement[0] < SETTLED;
                agrees_more || (sees(&next) && !sees(so_far))
            }
        };
        refuted = next.past[0] >= SETTLED;
        if is_better {
            (best, source) = (Some(next), i);
        }
        if refuted {
            break;
        }
    }
    let agreement = best.as_ref().map_or(0.0, |fetch| fetch.agreement[0]);
    Found { fetch: best, source, settled: q > 0.0 && !refuted && agreement >= SETTLED }
}

/// An unsettled pixel at a cell. `bits` is the filled cell.
#[inline(always)]
pub(super) fn pixel(view: &View<'_>, cells: &[u32], at: usize, bits: u32, d: [f32; 3]) -> Pixel {
    let columns = view.columns;
    let was = depth_of_cell(cells[at]);
    let cell = |at: usize| cells.get(at).map_or(Depth { q: 0.0, source: 0 }, |cell| depth_of_cell(*cell));
    // A piece has a ring of cells around those of its pixels.
    let around = [
        at - 1,
        at + 1,
        at - columns,
        at + columns,
        at - columns - 1,
        at - columns + 1,
        at + columns - 1,
        at + columns + 1,
    ];
    let behind = around.into_iter().fold(was, |so_far, at| {
        let next = cell(at);
        if next.q > 0.0 { farther(so_far, next) } else { so_far }
    });
    // First the filled depth if it is a guess. Otherwise the warp has tried it, and the farthest depth nearby is tried: a cell keeps
    // its nearest texel, but the pixel may lie beside that surface's edge. Then the cell's depth before filling.
    let became = depth_of(bits);
    let first = if became.q < 0.0 { -became.q } else { behind.q };
    let before = (was.q > 0.0 && was.q != became.q && was.q != behind.q).then_some(was.q);
    let mut found = Found { fetch: None, source: 0, settled: false };
    for attempt in 0..3 {
        let q = match attempt {
            0 => first,
            1 => match before {
                Some(q) => q,
                None => continue,
            },
            _ if ray_is_sky(view, d) => return view.seen_sky(d),
            _ => march(view, d).map_or(0.0, |t| 1.0 / t.max(1e-20)),
        };
        found = look_up(view, d, q);
        if found.settled {
            break;
        }
    }
    match (&found.fetch, found.settled) {
        (Some(fetch), true) => {
            let mut pixel = view.surface(fetch, 0, found.source, d);
            let is_other = found.source as u32 != became.source && pixel.source != UNRESOLVED;
            pixel.source += if is_other { OTHER_SAMPLE } else { 0 };
            pixel
        }
        (Some(fetch), false) => view.unresolved(fetch, found.source),
        (None, _) => Pixel { source: UNRESOLVED, confidence: 0, ..view.sky(d) },
    }
}

/// Whether a frame looks at each of eight points of a ray, and sees past it, one bit each.
#[inline(always)]
fn test_points(view: &View<'_>, index: usize, d: [f32; 3], start: f32, step: f32) -> [u32; 2] {
    let source = &view.sources[index];
    let (sample, frame) = (&source.sample, source.frame);
    let rows = [sample.u_from_world, sample.v_from_world, sample.w_from_world];
    let first = rows.map(|row| dot3(row, sample.eye_from_center));
    let along = rows.map(|row| dot3(row, d));
    let (width, height) = (frame.width as f32, frame.height as f32);
    let (mut places, mut lengths, mut inside) = ([[0.0; LANES]; 2], [0.0; LANES], [false; LANES]);
    for k in 0..LANES {
        let t = start + step * (k + 1) as f32;
        let ray = [0, 1, 2].map(|axis| d[axis] * t + sample.eye_from_center[axis]);
        let h = [0, 1, 2].map(|axis| first[axis] + along[axis] * t);
        let by_w = 1.0 / h[2].max(1e-30);
        let (u, v) = (h[0] * by_w, h[1] * by_w);
        inside[k] = (h[2] > 0.0) & (u >= 0.0) & (u <= 1.0) & (v >= 0.0) & (v <= 1.0);
        (places[0][k], places[1][k]) = (u * width, v * height);
        lengths[k] = dot3(ray, ray);
    }
    let (mut seen, mut clear) = (0, 0);
    for k in (0..LANES).filter(|k| inside[*k]) {
        let stored = nearest(frame, [places[0][k], places[1][k]]);
        seen |= 1 << k;
        // Sky is stored as 0, which is beyond every point.
        clear |= u32::from(stored * stored * lengths[k] < 1.0) << k;
    }
    [seen, clear]
}

/// Inverse range at a place inside the image.
fn nearest(frame: &HostFrame, [x, y]: [f32; 2]) -> f32 {
    let [x, y] = [(x as usize).min(frame.width - 1), (y as usize).min(frame.height - 1)];
    frame.inverse_range[y * frame.width + x]
}

/// Whether some frame sees past each of eight points of the ray within the scene's extent, and past each of eight within its bounds
/// where these are larger.
#[inline(always)]
pub(super) fn ray_is_sky(view: &View<'_>, d: [f32; 3]) -> bool {
    let span = crossing(view.of.bounds_min, view.of.bounds_max, d);
    let near = crossing_of_extent(view, span, d);
    frames_see_past(view, d, near) && (near == span || frames_see_past(view, d, span))
}

/// Whether some frame sees past each of eight points between two depths. True if there is nothing between.
#[inline(always)]
fn frames_see_past(view: &View<'_>, d: [f32; 3], span: [f32; 2]) -> bool {
    const ALL: u32 = (1 << POINTS) - 1;
    let step = (span[1] - span[0]) / POINTS as f32;
    let mut clear = if span[0] >= span[1] { ALL } else { 0 };
    for i in 0..view.sources.len() {
        if clear == ALL {
            break;
        }
        clear |= test_points(view, i, d, span[0], step)[1];
    }
    clear == ALL
}

/// The part of a ray between two depths that lies within the scene's extent; empty if none does.
fn crossing_of_extent(view: &View<'_>, span: [f32; 2], d: [f32; 3]) -> [f32; 2] {
    let near = crossing(view.of.extent_min, view.of.extent_max, d);
    [near[0].max(span[0]), near[1].min(span[1])]
}

/// Depths at which a ray enters and leaves a box; the entry is at least 0. entry >= exit if it misses.
fn crossing(min: [f32; 3], max: [f32; 3], d: [f32; 3]) -> [f32; 2] {
    let mut span = [0f32, f32::INFINITY];
    for axis in 0..3 {
        let steep = if d[axis].abs() < 1e-20 { 1e-20 } else { d[axis] };
        let (a, b) = (min[axis] / steep, max[axis] / steep);
        span = [span[0].max(a.min(b)), span[1].min(a.max(b))];
    }
    span
}

/// The depth at which a ray meets what the frames saw: it is followed in equal steps through the scene's extent, and what lies before
/// and behind, until it is behind the surface of every frame that looks there. `None` if it meets nothing.
fn march(view: &View<'_>, d: [f32; 3]) -> Option<f32> {
    let span = crossing(view.of.bounds_min, view.of.bounds_max, d);
    let crossing = crossing_of_extent(view, span, d);
    let near = if crossing[0] < crossing[1] { crossing } else { span };
    [[span[0], near[0]], near, [near[1], span[1]]].into_iter().find_map(|part| march_part(view, d, part))
}

/// Follows the ray between two depths.
fn march_part(view: &View<'_>, d: [f32; 3], span: [f32; 2]) -> Option<f32> {
    if !(span[0] < span[1]) {
        return None;
    }
    let step = (span[1] - span[0]) / STEPS_ALONG as f32;
    let tests = |start: f32, step: f32| {
        (0..view.sources.len()).fold([0, 0], |all: [u32; 2], i| {
            let one = test_points(view, i, d, start, step);
            [all[0] | one[0], all[1] | one[1]]
        })
    };
    for k in (0..STEPS_ALONG).step_by(LANES) {
        let [seen, clear] = tests(span[0] + step * k as f32, step);
        let inside = seen & !clear;
        if inside != 0 {
            let outside = span[0] + step * (k + inside.trailing_zeros()) as f32;
            // The near side of the surface: the most conservative one.
            let [seen, clear] = tests(outside, step / PARTS);
            return Some(outside + step / PARTS * (seen & !clear).trailing_zeros().min(POINTS - 1) as f32);
        }
    }
    None
}
