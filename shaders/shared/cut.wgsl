// What decides where a view's cut through a tree of balls lies (ManyLoDs, section 3).
//
// A node is right for a view where it appears small enough or is not seen. How far from that verdict a node is is told
// as a length that changes by at most as much as the view or the ball moves: until then it need not be tested again.
// Coordinates are in edges of the scene's root cube.

// A view as cuts see it: three vec4f, position and generation (u32 bits); axis of what it sees, cosine of half the
// angle; the direction in which it moved last, zero where it did not.
struct Eye {
    position: vec3f,
    generation: u32,
    axis: vec3f,
    cos_seen: f32,
}

const EYE_WORDS: u32 = 3u;

fn eye_from(first: vec4f, second: vec4f) -> Eye {
    return Eye(first.xyz, bitcast<u32>(first.w), second.xyz, second.w);
}

// An entry of a cut: a node, and a view with the generation of its cut above it.
const VIEW_BITS: u32 = 24u;
const VIEW_MASK: u32 = 0xffffffu;

// A cosine below which a view sees everything.
const ALL_SEEN: f32 = -0.9999;

// How far a ball is outside what a view sees; not above 0 where it may be seen. Changes by at most as much as either
// moves.
fn cut_unseen(ball: vec4f, eye: Eye) -> f32 {
    let vs = ball.xyz - eye.position;
    let squared = dot(vs, vs);
    // The distance from the cone of what is seen: of a point beside it, from its surface; of one behind, from its tip.
    let along = dot(eye.axis, vs);
    let away = sqrt(max(squared - along * along, 0.0));
    let sin_seen = sqrt(max(1.0 - eye.cos_seen * eye.cos_seen, 0.0));
    let beside = away * eye.cos_seen - along * sin_seen;
    let behind = beside > 0.0 && along * eye.cos_seen + away * sin_seen < 0.0;
    let unseen = select(beside, sqrt(squared), behind) - ball.w * 1.00001 - 1e-6;
    return select(-1.0, unseen, eye.cos_seen > ALL_SEEN);
}

// Above 0 where a ball of radius R appears smaller than the threshold or is not seen, and then how far it is from not
// being so; else how far from being so, below 0. `scale` is texels of a hemisphere's side by the threshold.
//
// A ball at the distance D whose x, along the maps' axis, is X covers side · R / (X + √(D² − R²)) texels. The smallest step
// by which X and D both shrink (grow) until that is the threshold follows without a root: it is D − (K² + R²) / 2K with
// K = scale · R + D − X. Its gradient is at most 1 by position, and by R at most scale / 2 + 1.
fn cut_value(ball: vec4f, eye: Eye, scale: f32, culls: bool) -> f32 {
    let vs = ball.xyz - eye.position;
    let away_from = length(vs);
    let x = abs(vs.x);
    let g = scale * ball.w;
    let small = 0.5 * (away_from + x - g - ball.w * ball.w / max(g + away_from - x, 1e-37));
    if culls {
        return max(small, cut_unseen(ball, eye));
    }
    return small;
}

// How a view goes on: in a direction that turns by at most `bend` a unit of way.
struct Course {
    direction: vec3f,
    bend: f32,
    // 0: nothing is known of it.
    known: u32,
}

// More than what f32 rounds in a verdict, by the distance that it is about.
const ROUNDING: f32 = 2e-6;

// The way after which a margin may be used up that shrinks at `rate` along the course, and by half of `curve` times the
// square of the way beyond that; what holds for `most` of the way alone is used for that much. A margin is never used up
// before as much way as it is long.
fn way_for(margin: f32, rate: f32, curve: f32, most: f32) -> f32 {
    if margin <= 0.0 {
        return margin;
    }
    let faster = rate + 1e-4;
    let root = sqrt(faster * faster + 2.0 * curve * margin);
    // One of two ways to write the same, whichever takes no difference of near numbers.
    let ahead = 2.0 * margin / max(faster + root, 1e-12);
    let back = (root - faster) / max(curve, 1e-12);
    return max(margin, min(select(ahead, back, faster < 0.0), most));
}

// How far a view may go on before what holds of a ball, that it is right or that it is not, may not hold any more. The
// course's own turning takes 0.7 of its bend by the square of the way: half for how far aside it leads, a sixth for how
// much less ahead, while it turns by less than a radian.
fn cut_lasts(ball: vec4f, eye: Eye, course: Course, scale: f32, culls: bool, right: bool) -> f32 {
    let vs = ball.xyz - eye.position;
    let d = max(length(vs), 1e-12);
    let x = abs(vs.x);
    let g = scale * ball.w;
    let k = max(g + d - x, 1e-12);
    let small = 0.5 * (d + x - g - ball.w * ball.w / k);
    let unseen = cut_unseen(ball, eye);
    let pad = ROUNDING * (1.0 + length(eye.position));
    let sign_ = select(-1.0, 1.0, right);
    let of_small = sign_ * small - pad;
    let of_unseen = sign_ * unseen - pad;
    let looks = culls && eye.cos_seen > ALL_SEEN;
    var by_small = of_small;
    var by_unseen = of_unseen;
    if course.known != 0u {
        let most = 1.0 / max(course.bend, 1e-6);
        let q = ball.w * ball.w / (k * k);
        let nearer = -dot(vs, course.direction) / d;
        let x_nearer = -sign(vs.x) * course.direction.x;
        let rate = -sign_ * 0.5 * ((1.0 + q) * nearer + (1.0 - q) * x_nearer);
        // Distances are convex: they make what is small smaller, and what is not small less so, the other way round.
        let curve = 1.4 * course.bend + 0.75 / k + select(1.0 / d, 0.0, right);
        let of_x = select(x, 8.0, right);
        by_small = way_for(of_small, rate, curve, min(min(most, of_x), min(0.25 * d, 0.125 * k)));
        // Of half spaces alone: the distance from a plane is linear.
        if abs(eye.cos_seen) < 1e-3 {
            let fall = -sign_ * dot(eye.axis, course.direction);
            by_unseen = way_for(of_unseen, fall, 1.4 * course.bend + 0.01, most);
        }
    }
    if right {
        return select(by_small, max(by_small, by_unseen), looks);
    }
    return select(by_small, min(by_small, by_unseen), looks);
}
