//! Trees of balls: what each holds, and what happens as triangles move.

use argus_manylods::{SphereBuilder, SphereHierarchy};
use argus_megaviews::hierarchy::{HierarchyError, RootCube, Triangle, stream};
use glam::{DVec3, Vec3};

use crate::device::{gpu, read};
use crate::numbers::Numbers;

/// Middle, radius and cone of each node, in f64.
struct Balls {
    centers: Vec<DVec3>,
    radii: Vec<f64>,
    axes: Vec<DVec3>,
    cosines: Vec<f64>,
}

impl Balls {
    fn of(tree: &SphereHierarchy) -> Self {
        let count = tree.node_count() as usize;
        let (spheres, cones): (Vec<[f32; 4]>, Vec<[f32; 4]>) =
            (read(&tree.spheres, count), read(&tree.cones, count));
        let vector = |w: &[f32; 4]| Vec3::new(w[0], w[1], w[2]).as_dvec3();
        Self {
            centers: spheres.iter().map(vector).collect(),
            radii: spheres.iter().map(|w| f64::from(w[3])).collect(),
            axes: cones.iter().map(vector).collect(),
            cosines: cones.iter().map(|w| f64::from(w[3])).collect(),
        }
    }

    /// Every ball holds its children's, every cone the normals of all leaves below it, and nothing is NaN.
    fn check(&self) {
        let count = self.centers.len();
        for node in 0..count {
            assert!(self.centers[node].is_finite() && self.radii[node] > 0.0 && self.cosines[node] >= -1.0);
            for child in (2 * node + 1..=2 * node + 2).filter(|child| *child < count) {
                let reach = self.centers[node].distance(self.centers[child]) + self.radii[child];
                assert!(
                    reach < self.radii[node],
                    "ball {child} reaches out of {node}: {reach} {}",
                    self.radii[node]
                );
            }
        }
        let leaves = count / 2..count;
        for leaf in leaves {
            let mut node = leaf;
            while node > 0 {
                node = (node - 1) / 2;
                let cosine = self.axes[node].dot(self.axes[leaf]);
                assert!(cosine >= self.cosines[node], "normal {leaf} is outside cone {node}: {cosine}");
            }
        }
    }
}

/// Triangles of all sizes and directions in a cube of 10 m, one in ten without area.
fn soup(count: usize, seed: u64) -> Vec<Triangle> {
    let mut numbers = Numbers(seed);
    let mut triangle = |i: usize| {
        let size = 10f64.powf(-2.0 * numbers.unit());
        let at = numbers.point() * 10.0;
        let mut corner = || at + (numbers.point() - 0.5) * size;
        let [a, b, c] = [corner(), corner(), corner()];
        Triangle { corners: [a, b, if i % 10 == 3 { a } else { c }], color: Vec3::ONE }
    };
    (0..count).map(&mut triangle).collect()
}

fn root_of(triangles: &[Triangle]) -> RootCube {
    RootCube::around(&stream::bounds(triangles.iter().copied()))
}

fn build(depth: u32, triangles: &[Triangle]) -> SphereHierarchy {
    SphereBuilder::new(&gpu()).build(root_of(triangles), depth, triangles).unwrap()
}

#[test]
fn balls_hold_what_is_below_them_and_cones_every_normal() {
    for (count, depth) in [(3, 1), (50, 6), (500, 12)] {
        Balls::of(&build(depth, &soup(count, 1))).check();
    }
}

#[test]
fn neighbours_in_the_tree_are_neighbours_in_space() {
    // A square, evenly covered: half of it is a rectangle at best, an L or a strip at worst.
    let flat = |a: DVec3, b: DVec3, c: DVec3| Triangle { corners: [a, b, c], color: Vec3::ONE };
    let triangles =
        [flat(DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y), flat(DVec3::ZERO, DVec3::X + DVec3::Y, DVec3::Y)];
    let balls = Balls::of(&build(12, &triangles));
    // The ball of a square of 2^-level of the area has a radius of half its diagonal.
    for level in [2u32, 4, 6, 8] {
        let nodes = (1usize << level) - 1..(2usize << level) - 1;
        let ideal = 0.5f64.sqrt() * 0.5f64.powf(f64::from(level) * 0.5);
        let mean = nodes.clone().map(|node| balls.radii[node]).sum::<f64>() / nodes.len() as f64;
        assert!(mean < 1.9 * ideal, "level {level}: {mean} for {ideal}");
    }
}

#[test]
fn a_tree_over_one_triangle_covers_it() {
    let triangles = [Triangle { corners: [DVec3::ZERO, DVec3::X * 2.0, DVec3::Y * 2.0], color: Vec3::ONE }];
    let tree = build(8, &triangles);
    let balls = Balls::of(&tree);
    balls.check();
    let mut numbers = Numbers(7);
    for _ in 0..2000 {
        let (s, t) = (numbers.unit(), numbers.unit());
        let (s, t) = if s + t > 1.0 { (1.0 - s, 1.0 - t) } else { (s, t) };
        let point = tree.root.unit_from_world(DVec3::new(2.0 * s, 2.0 * t, 0.0));
        let near = |leaf: &usize| balls.centers[*leaf].distance(point) <= balls.radii[*leaf] * 1.2;
        assert!((255..511).any(|leaf| near(&leaf)), "{s} {t}");
    }
    assert!((balls.cosines[0] - 1.0).abs() < 1e-4, "a plane has one normal");
}

#[test]
fn what_has_no_area_makes_no_tree_and_what_is_nowhere_none_that_is() {
    let builder = SphereBuilder::new(&gpu());
    let cube = RootCube { origin: DVec3::ZERO, edge: 1.0 };
    let flat = Triangle { corners: [DVec3::ONE; 3], color: Vec3::ONE };
    let nowhere = Triangle { corners: [DVec3::NAN; 3], color: Vec3::ONE };
    assert!(matches!(builder.build(cube, 4, &[flat, nowhere]), Err(HierarchyError::Empty)));
    assert!(matches!(builder.build(cube, 4, &[]), Err(HierarchyError::Empty)));
    let depths = [0, 23].map(|depth| builder.build(cube, depth, &soup(3, 1)));
    assert!(depths.iter().all(|tree| matches!(tree, Err(HierarchyError::OutOfRange { .. }))));
    let mut some = soup(20, 3);
    some.push(nowhere);
    Balls::of(&build(8, &some)).check();
    // A triangle that is nowhere for a while is in the middle of the cube, and back afterwards.
    let mut tree = build(8, &some[..20]);
    let before: Vec<[f32; 4]> = read(&tree.spheres, 511);
    builder.update(&mut tree, &[vec![nowhere; 5], some[5..20].to_vec()].concat()).unwrap();
    assert!(read::<f32>(&tree.spheres, 511 * 4).iter().all(|x| x.is_finite()));
    builder.update(&mut tree, &some[..20]).unwrap();
    assert_eq!(read::<[f32; 4]>(&tree.spheres, 511), before);
}

#[test]
fn triangles_a_million_metres_away_make_the_same_bytes() {
    let far = DVec3::new(f64::from(1 << 20), f64::from(-(1 << 21)), f64::from(3 << 20));
    let quantised =
        |t: &Triangle| Triangle { corners: t.corners.map(|c| (c * 1024.0).round() / 1024.0), ..*t };
    let near: Vec<Triangle> = soup(200, 5).iter().map(quantised).collect();
    let moved: Vec<Triangle> =
        near.iter().map(|t| Triangle { corners: t.corners.map(|c| c + far), ..*t }).collect();
    let [here, there] = [&near, &moved].map(|triangles| build(10, triangles));
    for (a, b) in [(&here.spheres, &there.spheres), (&here.cones, &there.cones), (&here.nodes, &there.nodes)]
    {
        assert_eq!(read::<u32>(a, 2047 * 4), read::<u32>(b, 2047 * 4));
    }
}

#[test]
fn an_update_fits_balls_to_triangles_that_moved_and_a_rebuild_makes_them_tighter() {
    let triangles = soup(400, 9);
    let mut root = root_of(&triangles);
    root.edge *= 1.5;
    let builder = SphereBuilder::new(&gpu());
    let mut tree = builder.build(root, 12, &triangles).unwrap();
    // Every other triangle goes to the opposite side.
    let moved: Vec<Triangle> = (0..)
        .zip(&triangles)
        .map(|(i, t)| match i % 2 {
            0 => *t,
            _ => Triangle { corners: t.corners.map(|c| DVec3::new(10.0 - c.x, c.y, c.z)), ..*t },
        })
        .collect();
    let moves = |tree: &SphereHierarchy| read::<u32>(&tree.moved, 2)[0];
    let before = moves(&tree);
    builder.update(&mut tree, &moved).unwrap();
    assert!(moves(&tree) - before > 1 << 20, "leaves crossed a quarter of the cube");
    let updated = Balls::of(&tree);
    updated.check();
    let before = moves(&tree);
    builder.update(&mut tree, &moved).unwrap();
    assert_eq!(moves(&tree), before, "nothing moved");
    builder.rebuild(&mut tree, &moved).unwrap();
    let rebuilt = Balls::of(&tree);
    rebuilt.check();
    let volume = |balls: &Balls| balls.radii[..4095].iter().map(|r| r * r).sum::<f64>();
    assert!(volume(&rebuilt) < 0.5 * volume(&updated), "{} {}", volume(&rebuilt), volume(&updated));
    // The same as if it had been made there.
    assert!(builder.update(&mut tree, &moved[1..]).is_err(), "another number of triangles");
    let fresh = Balls::of(&builder.build(root, 12, &moved).unwrap());
    assert!((volume(&rebuilt) / volume(&fresh) - 1.0).abs() < 0.05);
}
