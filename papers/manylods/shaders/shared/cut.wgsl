// The test that places a view's cut through a sphere tree (ManyLoDs, section 3).
//
// A node is fine enough for a view if it appears small enough or is not seen. The test gives a margin: a length that
// changes by at most the motion of the view or the sphere. Until they have moved that far, the node need not be tested
// again. Coordinates are in edges of the scene's root cube.

// A view, stored as three vec4f: position and generation (u32 bits); axis of the view cone and cosine of its half angle;
// direction of the last motion, zero if it did not move.
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

// Second word of an entry of a cut: the view in the lower bits, the generation of its cut above them.
const VIEW_BITS: u32 = 24u;
const VIEW_MASK: u32 = 0xffffffu;

// Cosine of the half angle below which a view sees all directions.
const ALL_SEEN: f32 = -0.9999;

// Distance of a sphere from the view's cone; at most 0 if it may be seen. Changes by at most the motion of the view or the
// sphere.
fn cut_unseen(sphere: vec4f, eye: Eye) -> f32 {
    let vs = sphere.xyz - eye.position;
    let squared = dot(vs, vs);
    // Distance from the cone: of a point beside it, from its surface; of a point behind it, from its tip.
    let along = dot(eye.axis, vs);
    let away = sqrt(max(squared - along * along, 0.0));
    let sin_seen = sqrt(max(1.0 - eye.cos_seen * eye.cos_seen, 0.0));
    let beside = away * eye.cos_seen - along * sin_seen;
    let behind = beside > 0.0 && along * eye.cos_seen + away * sin_seen < 0.0;
    let unseen = select(beside, sqrt(squared), behind) - sphere.w * 1.00001 - 1e-6;
    return select(-1.0, unseen, eye.cos_seen > ALL_SEEN);
}

// Margin of a node's test: above 0 if the sphere appears smaller than the threshold or is not seen, else at most 0. Its
// magnitude is the least motion that changes the result. `scale`: texels of a hemisphere's side, divided by the threshold.
//
// A sphere of radius R at the distance D, with the coordinate X along the maps' axis, covers side · R / (X + √(D² − R²))
// texels. The least step by which X and D must both shrink or grow to reach the threshold is D − (K² + R²) / 2K, where
// K = scale · R + D − X. Its gradient is at most 1 by position, and at most scale / 2 + 1 by R.
fn cut_margin(sphere: vec4f, eye: Eye, scale: f32, culls: bool) -> f32 {
    let vs = sphere.xyz - eye.position;
    let away_from = length(vs);
    let x = abs(vs.x);
    let g = scale * sphere.w;
    let small = 0.5 * (away_from + x - g - sphere.w * sphere.w / max(g + away_from - x, 1e-37));
    if culls {
        return max(small, cut_unseen(sphere, eye));
    }
    return small;
}

// Predicted motion of a view.
struct Course {
    // Unit direction of the last motion.
    direction: vec3f,
    // Largest curvature, radians per edge.
    bend: f32,
    // 0: no prediction.
    known: u32,
}

// Bound of a margin's rounding error, relative to distance.
const ROUNDING: f32 = 2e-6;

// Least distance along the course after which a margin may reach 0. The margin shrinks by `rate` times the distance, and by
// half of `curve` times its square. These bounds hold for the distance `most` only. Without them, a margin lasts for a
// distance of its own length.
fn distance_to_zero(margin: f32, rate: f32, curve: f32, most: f32) -> f32 {
    if margin <= 0.0 {
        return margin;
    }
    let faster = rate + 1e-4;
    let root = sqrt(faster * faster + 2.0 * curve * margin);
    // Two forms of the same root; the selected one has no cancellation.
    let ahead = 2.0 * margin / max(faster + root, 1e-12);
    let back = (root - faster) / max(curve, 1e-12);
    return max(margin, min(select(ahead, back, faster < 0.0), most));
}

// Slack: motion of the view before the result of a node's test may change. `right`: the result is that the node is fine
// enough. Curvature of the course costs 0.7 · bend · distance²: 1/2 sideways and 1/6 ahead, while it turns by less than a
// radian.
fn cut_slack(sphere: vec4f, eye: Eye, course: Course, scale: f32, culls: bool, right: bool) -> f32 {
    let vs = sphere.xyz - eye.position;
    let d = max(length(vs), 1e-12);
    let x = abs(vs.x);
    let g = scale * sphere.w;
    let k = max(g + d - x, 1e-12);
    let small = 0.5 * (d + x - g - sphere.w * sphere.w / k);
    let unseen = cut_unseen(sphere, eye);
    let pad = ROUNDING * (1.0 + length(eye.position));
    let sign_ = select(-1.0, 1.0, right);
    let of_small = sign_ * small - pad;
    let of_unseen = sign_ * unseen - pad;
    let looks = culls && eye.cos_seen > ALL_SEEN;
    var by_small = of_small;
    var by_unseen = of_unseen;
    if course.known != 0u {
        let most = 1.0 / max(course.bend, 1e-6);
        let q = sphere.w * sphere.w / (k * k);
        let nearer = -dot(vs, course.direction) / d;
        let x_nearer = -sign(vs.x) * course.direction.x;
        let rate = -sign_ * 0.5 * ((1.0 + q) * nearer + (1.0 - q) * x_nearer);
        // Distance is convex in the position: that raises the margin of a small node, and lowers that of a large one.
        let curve = 1.4 * course.bend + 0.75 / k + select(1.0 / d, 0.0, right);
        let of_x = select(x, 8.0, right);
        by_small = distance_to_zero(of_small, rate, curve, min(min(most, of_x), min(0.25 * d, 0.125 * k)));
        // Only for half spaces, since the distance from a plane is linear.
        if abs(eye.cos_seen) < 1e-3 {
            let fall = -sign_ * dot(eye.axis, course.direction);
            by_unseen = distance_to_zero(of_unseen, fall, 1.4 * course.bend + 0.01, most);
        }
    }
    if right {
        return select(by_small, max(by_small, by_unseen), looks);
    }
    return select(by_small, min(by_small, by_unseen), looks);
}
