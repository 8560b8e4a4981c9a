//! Triangles of a scene in the world, and the pieces of them that get points.

use argus_scene::{Instance, Scene};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::cells::{Grid, Rows};
use super::density::{Density, density_at, distance};
use argus_sampler::plug::{Cutouts, MappedReflector, Side};

use super::Eye;

/// A triangle in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facet {
    /// Index into [`Scene::instances`].
    pub instance: u32,
    /// Index of the triangle in its mesh.
    pub primitive: u32,
    /// Metres, world space; counter-clockwise, seen from the front.
    pub corners: [DVec3; 3],
    /// Whether the back is seen, too.
    pub both_sides: bool,
    /// Whether parts of it are cut out.
    pub cutout: bool,
    /// Whether the second and third corner are exchanged, since its instance mirrors.
    pub mirrored: bool,
}

impl Facet {
    /// The triangles of instances at their poses. Triangles that are not finite or have no area are left out.
    pub fn all(scene: &Scene, placed: &[Instance]) -> Vec<Self> {
        let each = (0u32..).zip(placed).collect::<Vec<_>>();
        let of_instance = |(index, instance): &(u32, &Instance)| {
            let mesh = &scene.meshes[instance.mesh as usize];
            let material = &scene.materials[mesh.material as usize];
            let mirrored = instance.world_from_mesh.matrix3.determinant() < 0.0;
            let corner = |i: u32| {
                let position = mesh.positions.get(i as usize).copied().unwrap_or(Vec3::NAN);
                instance.world_from_mesh.transform_point3(mesh.origin + position.as_dvec3())
            };
            let mut facets = Vec::with_capacity(mesh.triangles());
            for (primitive, indices) in (0u32..).zip(mesh.indices.as_chunks::<3>().0) {
                let [a, b, c] = indices.map(corner);
                let area = (b - a).cross(c - a);
                if area.is_finite() && area != DVec3::ZERO {
                    facets.push(Self {
                        instance: *index,
                        primitive,
                        corners: if mirrored { [a, c, b] } else { [a, b, c] },
                        both_sides: material.double_sided,
                        cutout: material.alpha_cutoff().is_some(),
                        mirrored,
                    });
                }
            }
            facets
        };
        each.par_iter().flat_map_iter(of_instance).collect()
    }

    /// Front normal, times twice the area in square metres.
    pub fn area_vector(&self) -> DVec3 {
        let [a, b, c] = self.corners;
        (b - a).cross(c - a)
    }

    /// Weights of the mesh's second and third corner at a point of the plane.
    pub fn weights(&self, point: DVec3) -> [f64; 2] {
        let [a, b, c] = self.corners;
        let normal = self.area_vector();
        let squared = normal.length_squared();
        let second = (point - a).cross(c - a).dot(normal) / squared;
        let third = (b - a).cross(point - a).dot(normal) / squared;
        if self.mirrored { [third, second] } else { [second, third] }
    }

    /// A number in 0..1 that decides whether it is culled, the same in every frame.
    pub(super) fn chance(&self) -> f64 {
        argus_sampler::plug::mixed(u64::from(self.instance) << 32 | u64::from(self.primitive))
    }

    /// Whether `eye` sees its front or its back; `None` if it sees neither, or the triangle from its edge.
    pub fn side_towards(&self, eye: DVec3) -> Option<Side> {
        let normal = self.area_vector();
        let volume = normal.dot(eye - self.corners[0]);
        // A plane through the eye covers no texel.
        let least = 1e-12 * normal.length() * (eye - self.corners[0]).length();
        match (volume > least, volume < -least) {
            (true, _) => Some(Side::Front),
            (_, true) if self.both_sides => Some(Side::Back),
            _ => None,
        }
    }
}

/// A part of a triangle with points of one density, as seen from one side. A large triangle has several, since density
/// falls with the distance from reflectors; one that reflectors see from both sides has pieces for each.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Index of its facet.
    pub facet: u32,
    /// The side that is shaded.
    pub side: Side,
    /// Metres, world space.
    pub corners: [DVec3; 3],
    /// The grid of its cells.
    pub grid: Grid,
    /// Whether its one cell is not cut off at the triangle's edges: it stands for neighbours that were culled.
    pub whole_cell: bool,
}

impl Piece {
    /// The rows of its cells.
    pub fn rows(&self) -> Rows {
        // A whole cell is row 0, column 0: that of the middle three times.
        let middle = (self.corners[0] + self.corners[1] + self.corners[2]) / 3.0;
        self.grid.rows(if self.whole_cell { [middle; 3] } else { self.corners })
    }

    /// Row and column of each of its cells, in the order of points.
    pub(super) fn cells(&self) -> impl Iterator<Item = [u16; 2]> {
        let rows = self.rows();
        (0..rows.count).flat_map(move |row| rows.columns(row).map(move |column| [row as u16, column as u16]))
    }
}

/// Pieces, and for each a bit for every reflector whose middle sees it.
#[derive(Debug, Clone, Default)]
pub struct Pieces {
    /// In the order of facets.
    pub all: Vec<Piece>,
    /// [`Self::words`] for each piece; bit i of word w is reflector 64·w + i.
    pub visible: Vec<u64>,
    /// Words of bits of a piece.
    pub words: usize,
}

impl Pieces {
    /// The reflectors that see a piece, ascending.
    pub fn seen_by(&self, piece: usize) -> impl Iterator<Item = usize> {
        self.bits(piece).iter().enumerate().flat_map(|(word, &bits)| {
            let next = |bits: &u64| Some(bits & (bits - 1)).filter(|rest| *rest != 0);
            let from = Some(bits).filter(|bits| *bits != 0);
            std::iter::successors(from, next).map(move |bits| 64 * word + bits.trailing_zeros() as usize)
        })
    }

    /// The words of bits of a piece.
    pub(super) fn bits(&self, piece: usize) -> &[u64] {
        &self.visible[piece * self.words..(piece + 1) * self.words]
    }

    /// Adds a piece with its words of bits.
    pub(super) fn push(&mut self, piece: Piece, bits: &[u64]) {
        self.all.push(piece);
        self.visible.extend_from_slice(bits);
    }

    /// Bytes of pieces and bits.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.all[..]) + size_of_val(&self.visible[..])
    }
}

/// Triangles smaller than this, in cells, may be culled (section 3.2).
const CULLED_BELOW: f64 = 0.1;
/// A piece with an edge longer than its distance from a reflector's middle is quartered.
const LONGEST: f64 = 1.0;
/// Pieces with fewer cells than this are not quartered.
const FEWEST: f64 = 64.0;
/// Most times that a triangle is quartered.
const DEEPEST: u32 = 6;

/// What pieces are made for.
pub(super) struct Cutter<'a> {
    pub(super) eye: &'a Eye,
    pub(super) reflectors: &'a [MappedReflector],
    pub(super) density: Density,
    /// Whether most triangles below a tenth of a cell are left out.
    pub(super) culling: bool,
}

/// A piece with its bits.
struct Cut {
    piece: Piece,
    bits: Vec<u64>,
    culled: bool,
}

impl Cutter<'_> {
    /// The pieces of all facets, without those that are culled.
    #[cfg(test)]
    pub(super) fn cut(&self, facets: &[Facet]) -> Pieces {
        self.cut_and_culled(facets)[0].clone()
    }

    /// The pieces of all facets, and those that are culled.
    pub(super) fn cut_and_culled(&self, facets: &[Facet]) -> [Pieces; 2] {
        let words = self.reflectors.len().div_ceil(64);
        let cut = |(index, facet): (usize, &Facet)| {
            let mut found = Vec::new();
            let mut seen_by = [Vec::new(), Vec::new()];
            for (number, reflector) in self.reflectors.iter().enumerate() {
                let in_front = |corner: &DVec3| reflector.front.is_none_or(|front| front.contains(*corner));
                if reflector.instance != facet.instance
                    && facet.corners.iter().any(in_front)
                    && let Some(side) = facet.side_towards(reflector.center)
                {
                    seen_by[side as usize].push(number);
                }
            }
            for (side, seen_by) in [Side::Front, Side::Back].into_iter().zip(&seen_by) {
                if !seen_by.is_empty() {
                    self.quarter(index as u32, facet, side, facet.corners, seen_by, 0, &mut found);
                }
            }
            found
        };
        let each: Vec<Cut> = facets.par_iter().enumerate().flat_map_iter(cut).collect();
        let mut pieces = [Pieces { words, ..Pieces::default() }, Pieces { words, ..Pieces::default() }];
        for cut in each {
            pieces[usize::from(cut.culled)].push(cut.piece, &cut.bits);
        }
        pieces
    }

    #[allow(clippy::too_many_arguments, reason = "a recursion over parts of one triangle")]
    fn quarter(
        &self,
        index: u32,
        facet: &Facet,
        side: Side,
        corners: [DVec3; 3],
        seen_by: &[usize],
        depth: u32,
        found: &mut Vec<Cut>,
    ) {
        let (mut density, mut nearest) = (0.0f64, f64::INFINITY);
        for &number in seen_by {
            let reflector = &self.reflectors[number];
            let distance = distance(reflector, corners);
            density = density.max(density_at(self.eye, reflector, corners, distance, &self.density));
            nearest = nearest.min(distance);
        }
        let [a, b, c] = corners;
        let cells = (b - a).cross(c - a).length() * 0.5 * density * density;
        let longest = (b - a).length().max((c - b).length()).max((a - c).length());
        if depth < DEEPEST && longest > LONGEST * nearest && cells > FEWEST {
            let [ab, bc, ca] = [(a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5];
            for part in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
                self.quarter(index, facet, side, part, seen_by, depth + 1, found);
            }
            return;
        }
        let small = self.culling && depth == 0 && cells < CULLED_BELOW;
        let culled = small && facet.chance() >= cells / CULLED_BELOW;
        let whole_cell = small && !culled;
        let grid =
            if whole_cell { Grid::around_middle(corners, density) } else { Grid::new(corners, density) };
        let Some(grid) = grid else { return };
        let mut bits = vec![0u64; self.reflectors.len().div_ceil(64)];
        seen_by.iter().for_each(|&number| bits[number / 64] |= 1 << (number % 64));
        let piece = Piece { facet: index, side, corners, grid, whole_cell };
        found.push(Cut { piece, bits, culled });
    }
}

/// Whether a cut-out is open somewhere.
pub(crate) trait Openings: Sync {
    /// Whether rays pass through a point of a facet.
    fn is_open(&self, facet: &Facet, point: DVec3) -> bool;
}

impl Openings for Cutouts {
    fn is_open(&self, facet: &Facet, point: DVec3) -> bool {
        let [second, third] = facet.weights(point);
        self.let_through([facet.instance, facet.primitive], second as f32, third as f32)
    }
}

#[cfg(test)]
mod tests {
    use argus_scene::procedural::{mirrors, rooms, terrain, with_balls};

    use super::*;
    use crate::tests::{eye_of, reflectors_of};

    fn cut(scene: &Scene, culling: bool, density: Density) -> (Vec<Facet>, Vec<MappedReflector>, Pieces) {
        let eye = eye_of(scene, [160, 120]);
        let reflectors = reflectors_of(scene, &eye);
        let facets = Facet::all(scene, &scene.at(0.0).instances);
        let pieces = Cutter { eye: &eye, reflectors: &reflectors, density, culling }.cut(&facets);
        (facets, reflectors, pieces)
    }

    #[test]
    fn a_bit_says_that_the_middle_of_a_reflector_sees_that_side() {
        for scene in [with_balls(rooms(20), 70).unwrap(), mirrors(5)] {
            let (facets, reflectors, pieces) = cut(&scene, false, Density::default());
            assert_eq!(pieces.words, reflectors.len().div_ceil(64));
            let mut seen = vec![[false; 2]; facets.len() * reflectors.len()];
            for (number, piece) in pieces.all.iter().enumerate() {
                for reflector in pieces.seen_by(number) {
                    seen[piece.facet as usize * reflectors.len() + reflector][piece.side as usize] = true;
                }
            }
            for (index, facet) in facets.iter().enumerate() {
                for (number, reflector) in reflectors.iter().enumerate() {
                    let volume = facet.area_vector().dot(reflector.center - facet.corners[0]);
                    let other = facet.instance != reflector.instance;
                    let expected = [other && volume > 0.0, other && volume < 0.0 && facet.both_sides];
                    assert_eq!(seen[index * reflectors.len() + number], expected, "{facet:?}");
                }
            }
        }
    }

    #[test]
    fn pieces_of_a_triangle_cover_its_area_and_large_ones_are_quartered() {
        let scene = with_balls(rooms(20), 4).unwrap();
        let (facets, _, pieces) = cut(&scene, false, Density { scale: 4.0, ..Density::default() });
        let mut areas = vec![[0.0; 2]; facets.len()];
        for piece in &pieces.all {
            let [a, b, c] = piece.corners;
            areas[piece.facet as usize][piece.side as usize] += (b - a).cross(c - a).length();
        }
        for (facet, areas) in facets.iter().zip(&areas) {
            for area in areas {
                let whole = facet.area_vector().length();
                assert!(*area == 0.0 || (area / whole - 1.0).abs() < 1e-9, "{area} {whole}");
            }
        }
        assert!(pieces.all.len() > facets.len() + 100, "{} {}", pieces.all.len(), facets.len());
    }

    #[test]
    fn culling_leaves_out_small_triangles_by_their_area_and_the_same_ones_each_time() {
        let scene = with_balls(terrain(50_000), 3).unwrap();
        let sparse = Density { reduction: 0.2, ..Density::default() };
        let [(_, _, all), (_, _, some)] = [false, true].map(|culling| cut(&scene, culling, sparse));
        let small = |piece: &&Piece| {
            let [a, b, c] = piece.corners;
            (b - a).cross(c - a).length() * 0.5 * piece.grid.density.powi(2) < CULLED_BELOW
        };
        let expected: f64 = all
            .all
            .iter()
            .filter(small)
            .map(|piece| {
                let [a, b, c] = piece.corners;
                (b - a).cross(c - a).length() * 0.5 * piece.grid.density.powi(2) / CULLED_BELOW
            })
            .sum();
        let kept = some.all.iter().filter(|piece| piece.whole_cell).count() as f64;
        assert!(all.all.iter().filter(small).count() > 500);
        assert!((kept - expected).abs() < 4.0 * expected.sqrt(), "{kept} of {expected}");
        assert_eq!(some.all, cut(&scene, true, sparse).2.all);
        assert!(some.all.iter().filter(|p| p.whole_cell).all(|piece| piece.rows().cells() == 1));
    }
}
