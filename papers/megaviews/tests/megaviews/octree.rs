//! The scene's octree against its oracle.

use std::collections::BTreeSet;
use std::io::Write;

use argus_gpu::{Gpu, GpuOptions};
use argus_megaviews::hierarchy::{HierarchyError, Octree, OctreeBuilder, RootCube, Triangle, stream};
use argus_scene::Bounds;
use glam::{DVec3, Vec3};

use crate::device::{gpu, read};
use crate::numbers::Numbers;
use crate::octree_oracle::cells;

/// More than the program widens cells by, and than corners are rounded to f32.
const MARGIN: f64 = 4e-6;

fn triangle(corners: [DVec3; 3]) -> Triangle {
    Triangle { corners, color: Vec3::new(0.2, 0.4, 0.6) }
}

fn root_of(triangles: &[Triangle]) -> RootCube {
    let mut bounds = Bounds::EMPTY;
    triangles.iter().flat_map(|t| t.corners).for_each(|corner| bounds.extend(corner));
    RootCube::around(&bounds)
}

/// Small ones, slivers, and some that span the root.
fn soup(seed: u64, count: usize) -> Vec<Triangle> {
    let mut numbers = Numbers(seed);
    (0..count)
        .map(|i| {
            let size = [0.01, 0.1, 1.0][i % 3];
            let a = numbers.point();
            let b = a + (numbers.point() - 0.5) * size;
            let thin = if i % 5 == 0 { 1e-4 } else { 1.0 };
            let c = if i % 5 == 0 { a + (b - a) * 0.4 } else { a } + (numbers.point() - 0.5) * size * thin;
            triangle([a, b, c])
        })
        .collect()
}

/// Builds it, and holds its node sets, links and attributes to the oracle.
fn check(triangles: &[Triangle], depth: u32) -> Octree {
    let root = root_of(triangles);
    let octree = OctreeBuilder::new(&gpu()).build(root, depth, triangles.iter().copied()).unwrap();
    let count = octree.node_count() as usize;
    let codes: Vec<u32> = read(&octree.codes, count);
    let nodes: Vec<[u32; 4]> = read(&octree.nodes, count);
    let cones: Vec<[f32; 4]> = read(&octree.cones, count);
    let colors: Vec<u32> = read(&octree.colors, count);
    assert_eq!(octree.levels[0], [count as u32 - 1, 1]);
    for level in 0..=depth {
        let [first, nodes_here] = octree.levels[level as usize];
        let range = first as usize..(first + nodes_here) as usize;
        let own = &codes[range.clone()];
        assert!(own.windows(2).all(|pair| pair[0] < pair[1]), "level {level}: sorted, each once");
        let set: BTreeSet<u32> = own.iter().copied().collect();
        let lost: Vec<_> = cells(&root, triangles, level, 0.0).difference(&set).copied().collect();
        assert!(lost.is_empty(), "level {level}: {} cells lost, {:?}", lost.len(), lost.first());
        if level == depth {
            let all = cells(&root, triangles, level, MARGIN);
            let strange: Vec<_> = set.difference(&all).copied().collect();
            assert!(strange.is_empty(), "level {level}: {} cells meet nothing", strange.len());
        }
        let along = f64::from(1u32 << level);
        for node in range {
            let mean = DVec3::from_array([0, 1, 2].map(|i| f64::from(f32::from_bits(nodes[node][i]))));
            let cell = (mean * along).floor().as_uvec3();
            assert_eq!(
                crate::octree_oracle::code(cell),
                codes[node],
                "level {level}: the mean lies in the cell"
            );
            let [x, y, z, cosine] = cones[node];
            assert!((Vec3::new(x, y, z).length() - 1.0).abs() < 1e-5 && (-1.0..=1.0).contains(&cosine));
            assert_eq!(colors[node] & 0xff_ffff, 51 | 102 << 8 | 153 << 16, "all triangles have one colour");
            let (first_child, mask) = (nodes[node][3] >> 8, nodes[node][3] & 0xff);
            assert_eq!(mask == 0, level == depth);
            let octants = (0..8).filter(|octant| mask >> octant & 1 == 1);
            for (at, octant) in octants.enumerate() {
                assert_eq!(codes[first_child as usize + at], codes[node] * 8 + octant);
            }
        }
        let children: u32 =
            own.iter().enumerate().map(|(i, _)| (nodes[first as usize + i][3] & 0xff).count_ones()).sum();
        if level < depth {
            assert_eq!(children, octree.levels[level as usize + 1][1], "every child has a parent");
        }
    }
    octree
}

#[test]
fn every_cell_that_a_triangle_meets_is_there_and_no_other() {
    check(&soup(1, 60), 5);
    check(&soup(2, 600), 4);
    check(&soup(3, 12), 7);
}

#[test]
fn a_single_triangle_is_an_octree_of_any_depth() {
    for depth in [1, 2, 10] {
        let small = [DVec3::ZERO, DVec3::new(1.0, 0.0, 0.01), DVec3::new(0.0, 0.02, 0.0)];
        check(&[triangle(small)], depth);
    }
}

#[test]
fn a_scene_a_million_metres_away_is_the_same_octree() {
    let near = soup(4, 100);
    let far = DVec3::new(1e6, -2e6, 3e6);
    let moved: Vec<Triangle> =
        near.iter().map(|t| Triangle { corners: t.corners.map(|c| c * 8.0 + far), ..*t }).collect();
    let octree = check(&moved, 6);
    let there = OctreeBuilder::new(&gpu()).build(root_of(&near), 6, near).unwrap();
    assert_eq!(octree.levels, there.levels);
}

#[test]
fn triangles_without_area_or_with_a_nan_are_no_surface() {
    let point = DVec3::splat(0.25);
    let line = [DVec3::ZERO, DVec3::splat(0.5), DVec3::ONE];
    let nan = [DVec3::ZERO, DVec3::X, DVec3::new(0.0, f64::NAN, 0.0)];
    let nothing = [[point; 3], line, nan].map(triangle);
    let build = |triangles: &[Triangle]| {
        let root = RootCube { origin: DVec3::ZERO, edge: 1.0 };
        OctreeBuilder::new(&gpu()).build(root, 3, triangles.iter().copied())
    };
    assert!(matches!(build(&nothing), Err(HierarchyError::Empty)));
    assert!(matches!(build(&[]), Err(HierarchyError::Empty)));
    let real = triangle([DVec3::splat(0.1), DVec3::new(0.9, 0.2, 0.1), DVec3::new(0.1, 0.9, 0.9)]);
    let with: Vec<Triangle> = nothing.into_iter().chain([real]).collect();
    assert_eq!(build(&with).unwrap().levels, build(&[real]).unwrap().levels);
}

#[test]
fn walls_on_the_borders_of_cells_belong_to_the_cells_on_both_sides() {
    let corners = [DVec3::new(0.5, 0.0, 0.0), DVec3::new(0.5, 1.0, 0.0), DVec3::new(0.5, 0.0, 1.0)];
    let root = RootCube { origin: DVec3::ZERO, edge: 1.0 };
    let octree = OctreeBuilder::new(&gpu()).build(root, 3, [triangle(corners)]).unwrap();
    let codes: Vec<u32> = read(&octree.codes, octree.leaf_count() as usize);
    let expected: Vec<u32> = cells(&root, &[triangle(corners)], 3, 0.0).into_iter().collect();
    assert!(expected.iter().all(|code| codes.contains(code)));
    assert_eq!(codes.iter().filter(|code| *code & 1 == 0).count() * 2, codes.len());
}

#[test]
fn a_depth_that_cannot_be_is_refused_by_name() {
    for depth in [0, 11] {
        let root = RootCube { origin: DVec3::ZERO, edge: 1.0 };
        let error = OctreeBuilder::new(&gpu()).build(root, depth, soup(1, 1)).unwrap_err();
        assert!(error.to_string().contains("levels must be 1 to 10"), "{error}");
    }
}

#[test]
fn two_builds_have_the_same_bytes() {
    let triangles = soup(9, 300);
    let build = || {
        let octree =
            OctreeBuilder::new(&gpu()).build(root_of(&triangles), 6, triangles.iter().copied()).unwrap();
        let count = octree.node_count() as usize;
        (read::<[u32; 4]>(&octree.nodes, count), read::<[u32; 4]>(&octree.cones, count))
    };
    assert_eq!(build(), build());
}

#[test]
fn the_device_is_waited_for_three_times_however_many_levels_there_are() {
    let gpu = Gpu::new(&GpuOptions::default()).unwrap();
    let builder = OctreeBuilder::new(&gpu);
    for depth in [1, 4, 9] {
        let triangles = soup(6, 200);
        let before = gpu.waits();
        let octree = builder.build(root_of(&triangles), depth, triangles).unwrap();
        assert_eq!(octree.levels.len(), depth as usize + 1);
        assert_eq!(gpu.waits() - before, 3, "{depth} levels");
    }
}

#[test]
fn more_cells_than_there_is_room_for_are_found_in_a_second_run() {
    // A wall on a border of cells is in the cells on both sides: twice as many as expected.
    let corners = [DVec3::new(0.5, 0.0, 0.0), DVec3::new(0.5, 1.0, 0.0), DVec3::new(0.5, 0.0, 1.0)];
    let root = RootCube { origin: DVec3::ZERO, edge: 1.0 };
    let gpu = Gpu::new(&GpuOptions::default()).unwrap();
    let builder = OctreeBuilder::new(&gpu);
    let before = gpu.waits();
    let octree = builder.build(root, 8, [triangle(corners)]).unwrap();
    assert_eq!(gpu.waits() - before, 4);
    let mut commands = gpu.commands("codes");
    let codes = commands.read_buffer(&octree.codes, 0..4 * u64::from(octree.leaf_count()));
    let codes = commands.submit().wait().unwrap().take(codes);
    let codes: Vec<u32> = bytemuck::pod_collect_to_vec(&codes[..4 * octree.leaf_count() as usize]);
    let expected: Vec<u32> = cells(&root, &[triangle(corners)], 8, 0.0).into_iter().collect();
    assert!(codes.len() > 65_000 && expected.iter().all(|code| codes.binary_search(code).is_ok()));
    assert_eq!(codes.iter().filter(|code| *code & 1 == 0).count() * 2, codes.len());
}

#[test]
fn sponza_has_the_cells_that_a_prototype_found() {
    let Some(folder) = std::env::var_os("ARGUS_SCENES") else {
        assert!(std::env::var_os("ARGUS_REQUIRE_SCENES").is_none(), "ARGUS_SCENES is not set");
        // What print macros say in a test that passes is shown to nobody.
        let _ = writeln!(std::io::stderr(), "SKIPPED, LOUDLY: ARGUS_SCENES is not set");
        return;
    };
    let file = std::path::Path::new(&folder).join("sponza/sponza.glb");
    let scene = argus_scene::load::load_path(file.to_str().unwrap()).unwrap();
    let pose = scene.at(0.0);
    let root = RootCube::around(&stream::bounds(stream::triangles(&scene, &pose)));
    let octree = OctreeBuilder::new(&gpu()).build(root, 8, stream::triangles(&scene, &pose)).unwrap();
    println!("{:?} {:?}", octree.levels, octree.times);
    // 110 and 529 thousand; the prototype's root cube was placed and rounded a little differently.
    let counts = [7, 8].map(|level: usize| octree.levels[level][1] as f64 / 1e3);
    assert!((counts[0] / 110.0 - 1.0).abs() < 0.03 && (counts[1] / 529.0 - 1.0).abs() < 0.03, "{counts:?}");
}
