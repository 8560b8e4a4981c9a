//! The tree's branches.

use glam::DVec3;

use crate::procedural::noise::{Random, circle};

/// A branch as a polyline that tapers.
#[derive(Debug, Clone)]
pub(in crate::procedural) struct Branch {
    /// Points from the foot to the tip, metres, world space, and the radius there.
    pub(in crate::procedural) points: Vec<(DVec3, f64)>,
    /// 0 for the trunk, one more for each fork.
    pub(in crate::procedural) level: usize,
}

impl Branch {
    /// Length from foot to tip along the branch, metres.
    pub(in crate::procedural) fn length(&self) -> f64 {
        self.points.windows(2).map(|pair| pair[0].0.distance(pair[1].0)).sum()
    }

    /// Point and radius at `t`, 0..1 over its segments.
    pub(in crate::procedural) fn at(&self, t: f64) -> (DVec3, f64) {
        let last = self.points.len() - 1;
        let s = t.clamp(0.0, 1.0) * last as f64;
        let i = (s as usize).min(last - 1);
        let ((a, ra), (b, rb)) = (self.points[i], self.points[i + 1]);
        let f = s - i as f64;
        (a.lerp(b, f), ra + (rb - ra) * f)
    }

    fn direction(&self, t: f64) -> DVec3 {
        let last = self.points.len() - 1;
        let i = ((t.clamp(0.0, 1.0) * last as f64) as usize).min(last - 1);
        (self.points[i + 1].0 - self.points[i].0).normalize()
    }
}

/// Growth of the branches of one level.
struct Habit {
    segments: usize,
    /// Sideways wander per segment.
    wobble: f64,
    /// Pull upwards per segment.
    lift: f64,
    /// Share of the radius left at the tip.
    tip: f64,
    children: usize,
    /// The children's first place, as a share of the length.
    first: f64,
    /// Length of the children, as a share of this branch's.
    ratio: f64,
    /// Cosine and sine of the angle between a child and its branch.
    spread: (f64, f64),
}

const HABITS: [Habit; 4] = [
    Habit {
        segments: 12,
        wobble: 0.07,
        lift: 0.05,
        tip: 0.30,
        children: 15,
        first: 0.30,
        ratio: 0.98,
        spread: (0.52, 0.85),
    },
    Habit {
        segments: 10,
        wobble: 0.15,
        lift: 0.05,
        tip: 0.22,
        children: 9,
        first: 0.22,
        ratio: 0.48,
        spread: (0.62, 0.78),
    },
    Habit {
        segments: 7,
        wobble: 0.20,
        lift: 0.05,
        tip: 0.25,
        children: 7,
        first: 0.18,
        ratio: 0.46,
        spread: (0.66, 0.75),
    },
    Habit {
        segments: 4,
        wobble: 0.22,
        lift: 0.0,
        tip: 0.3,
        children: 0,
        first: 0.0,
        ratio: 0.0,
        spread: (1.0, 0.0),
    },
];

/// Grows the tree from `foot`; its trunk is `height` metres long. Thick branches come first.
pub(in crate::procedural) fn grow(foot: DVec3, height: f64, random: &mut Random) -> Vec<Branch> {
    let mut branches = vec![sprout(foot, DVec3::new(0.04, 1.0, 0.02), height, height * 0.052, 0, random)];
    let mut next = 0;
    while next < branches.len() {
        let parent = branches[next].clone();
        next += 1;
        let habit = &HABITS[parent.level];
        let turn = random.unit();
        for i in 0..habit.children {
            let t = habit.first
                + (1.0 - habit.first) * (i as f64 + random.range(0.2, 0.8)) / habit.children as f64;
            let (from, radius) = parent.at(t);
            let axis = parent.direction(t);
            // The golden angle keeps successive branches out of each other's light.
            let (cos, sin) = circle(turn + 0.381_966 * i as f64 + random.range(-0.06, 0.06));
            let side = axis.any_orthonormal_vector();
            let out = side * cos + axis.cross(side) * sin;
            // Branches near the tip follow it; those near the foot leave at the full angle.
            let (along, away) = habit.spread;
            let direction = (axis * (along + 0.5 * t * t) + out * away).normalize();
            let shorten = if parent.level == 0 { 1.0 - 0.72 * t * t } else { 1.0 - 0.55 * t };
            let length = parent.length() * habit.ratio * shorten * random.range(0.85, 1.15);
            branches.push(sprout(from, direction, length, radius * 0.62, parent.level + 1, random));
        }
    }
    branches
}

fn sprout(
    foot: DVec3,
    direction: DVec3,
    length: f64,
    radius: f64,
    level: usize,
    random: &mut Random,
) -> Branch {
    let habit = &HABITS[level];
    let step = length / habit.segments as f64;
    let (mut at, mut along) = (foot, direction.normalize());
    let mut points = vec![(at, radius)];
    for i in 1..=habit.segments {
        along = (along + random.in_ball() * habit.wobble + DVec3::Y * habit.lift).normalize();
        at += along * step;
        let t = i as f64 / habit.segments as f64;
        points.push((at, radius * (1.0 + (habit.tip - 1.0) * t)));
    }
    if level == 0 {
        // The trunk flares into the ground.
        points[0].1 *= 1.7;
        points[0].0.y -= 1.5;
        points[1].1 *= 1.08;
    }
    Branch { points, level }
}
