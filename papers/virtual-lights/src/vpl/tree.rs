//! A tree over VPLs, for culling groups of them.
//!
//! Nodes are in depth-first order, with a skip link past the subtree. Leaves are ranges of the sorted VPLs.

use glam::{DVec3, Vec3};

use super::paths::Vpl;

/// A group of VPLs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Node {
    /// Centre of a bounding sphere of the positions.
    pub(crate) center: DVec3,
    /// Its radius.
    pub(crate) radius: f64,
    /// Axis of the cone of normals; zero if it covers all directions.
    pub(crate) axis: DVec3,
    /// Cosine of the cone's half angle, −1 for all directions.
    pub(crate) cosine: f64,
    /// Sum of their flux, mean of the channels, watts.
    pub(crate) power: f64,
    /// First VPL.
    pub(crate) first: u32,
    /// Number of VPLs.
    pub(crate) count: u32,
    /// The node after this subtree.
    pub(crate) skip: u32,
    /// Whether it is a leaf.
    pub(crate) leaf: bool,
}

/// Sorts VPLs into a tree of `levels` levels below its root, by repeated halving. Distance of normals counts like
/// distance of positions: opposite normals count as `spread` metres.
pub(crate) fn build(vpls: &mut [Vpl], levels: u32, spread: f64) -> Vec<Node> {
    let mut nodes = Vec::new();
    if !vpls.is_empty() {
        split(vpls, 0, levels, spread * 0.5, &mut nodes);
    }
    nodes
}

fn split(vpls: &mut [Vpl], first: u32, levels: u32, spread: f64, nodes: &mut Vec<Node>) {
    let index = nodes.len();
    nodes.push(around(vpls, first));
    if levels > 0 && vpls.len() > 1 {
        let at = |vpl: &Vpl, axis: usize| match axis {
            0..3 => vpl.position[axis],
            _ => f64::from(vpl.normal[axis - 3]) * spread,
        };
        let extent = |axis: usize| {
            let all = vpls.iter().map(|vpl| at(vpl, axis));
            let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
            high - low
        };
        let axis = (0..6).max_by(|&a, &b| extent(a).total_cmp(&extent(b))).unwrap_or(0);
        let middle = vpls.len() / 2;
        vpls.select_nth_unstable_by(middle, |a, b| at(a, axis).total_cmp(&at(b, axis)));
        let (low, high) = vpls.split_at_mut(middle);
        split(low, first, levels - 1, spread, nodes);
        split(high, first + middle as u32, levels - 1, spread, nodes);
        nodes[index].leaf = false;
    }
    nodes[index].skip = nodes.len() as u32;
}

/// A leaf of these VPLs, with slack for f32 rounding.
fn around(vpls: &[Vpl], first: u32) -> Node {
    let mut bounds = argus_scene::Bounds::EMPTY;
    vpls.iter().for_each(|vpl| bounds.extend(vpl.position));
    let center = bounds.center();
    let radius = vpls.iter().map(|vpl| vpl.position.distance(center)).fold(0.0, f64::max);
    let sum: Vec3 = vpls.iter().map(|vpl| vpl.normal).sum();
    let axis = sum.as_dvec3().normalize_or_zero();
    let cosine = vpls.iter().map(|vpl| vpl.normal.as_dvec3().dot(axis)).fold(1.0, f64::min);
    let wide = axis == DVec3::ZERO;
    Node {
        center,
        radius: radius * 1.000_01,
        axis,
        cosine: if wide { -1.0 } else { (cosine - 1e-5).max(-1.0) },
        power: vpls.iter().map(|vpl| f64::from(vpl.flux.element_sum()) / 3.0).sum(),
        first,
        count: vpls.len() as u32,
        skip: 0,
        leaf: true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use argus_sampler::plug::mixed;

    fn scattered(count: u32) -> Vec<Vpl> {
        let number = |i: u32, k: u32| mixed(u64::from(i) << 8 | u64::from(k)) * 2.0 - 1.0;
        let vector = |i, k| DVec3::new(number(i, k), number(i, k + 1), number(i, k + 2));
        let vpl = |i| Vpl {
            position: DVec3::splat(1e6) + vector(i, 0) * 10.0,
            normal: vector(i, 3).normalize().as_vec3(),
            flux: Vec3::splat(i as f32),
            bounces: 1,
        };
        (0..count).map(vpl).collect()
    }

    #[test]
    fn leaves_hold_every_vpl_once_and_nodes_hold_what_is_below_them() {
        for count in [0, 1, 2, 3, 100, 1000] {
            let mut vpls = scattered(count);
            let nodes = build(&mut vpls, 6, 20.0);
            let leaves: Vec<&Node> = nodes.iter().filter(|n| n.leaf).collect();
            assert_eq!(leaves.iter().map(|n| n.count).sum::<u32>(), count);
            assert!(leaves.windows(2).all(|w| w[0].first + w[0].count == w[1].first));
            assert!(leaves.len() <= 64);
            let mut fluxes: Vec<u32> = vpls.iter().map(|v| v.flux.x as u32).collect();
            fluxes.sort_unstable();
            assert!(fluxes.into_iter().eq(0..count));
            for (index, node) in nodes.iter().enumerate() {
                assert!(node.skip as usize > index && node.skip as usize <= nodes.len());
                for vpl in &vpls[node.first as usize..(node.first + node.count) as usize] {
                    assert!(vpl.position.distance(node.center) <= node.radius + 1e-9);
                    assert!(
                        vpl.normal.as_dvec3().dot(node.axis) >= node.cosine - 1e-6 || node.cosine == -1.0
                    );
                }
            }
        }
    }

    #[test]
    fn vpls_at_one_point_that_face_everywhere_make_a_node_that_faces_everywhere() {
        let mut vpls = scattered(2);
        vpls[1] = Vpl { normal: -vpls[0].normal, ..vpls[0] };
        let nodes = build(&mut vpls, 0, 20.0);
        assert_eq!((nodes.len(), nodes[0].cosine, nodes[0].radius), (1, -1.0, 0.0));
    }
}
