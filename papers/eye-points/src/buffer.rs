//! Which points are stored before they are splatted (sections 3.4 and 5.1).

use argus_scene::closest_on_triangle;
use rayon::prelude::*;

use super::cells::Point;
use super::facets::Pieces;
use argus_sampler::plug::MappedReflector;

/// How points come into maps. All ways give the same maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Splatting {
    /// All points are made first, and splatted then.
    Buffered,
    /// Points are splatted as they are made, and none is stored: a texel's point is found from its number.
    Bufferless,
    /// Points that are no wider than a texel in any map that sees them are splatted as they are made; only larger ones are
    /// stored. The paper's way for shadows (section 5.1).
    Hybrid,
}

impl Splatting {
    /// Extends the first stored points of pieces, and the number of all, to all pieces. `first` has the first point of each
    /// piece, and the number of all.
    pub(super) fn extend_stored(
        self,
        stored: &mut Vec<u32>,
        pieces: &Pieces,
        first: &[u32],
        reflectors: &[MappedReflector],
    ) {
        let begin = stored.len().saturating_sub(1);
        let count = |piece: usize| match self.stores(pieces, piece, reflectors) {
            true => first[piece + 1] - first[piece],
            false => 0,
        };
        let counts: Vec<u32> =
            (begin..pieces.all.len()).into_par_iter().with_min_len(256).map(count).collect();
        let mut next = stored.pop().unwrap_or_default();
        stored.push(next);
        stored.extend(counts.into_iter().map(|count| {
            next += count;
            next
        }));
    }

    fn stores(self, pieces: &Pieces, piece: usize, reflectors: &[MappedReflector]) -> bool {
        let wider = |map: usize| {
            let (reflector, piece) = (&reflectors[map], &pieces.all[piece]);
            let [a, b, c] = piece.corners;
            let cell = piece.grid.density.recip();
            let longest = (b - a).length().max((c - b).length()).max((a - c).length());
            let width = if piece.whole_cell { cell } else { cell.min(longest) };
            let nearest = closest_on_triangle(reflector.center, piece.corners) - reflector.center;
            width > 2.0 * nearest.length() / f64::from(reflector.side)
        };
        match self {
            Self::Buffered => true,
            Self::Bufferless => false,
            Self::Hybrid => pieces.seen_by(piece).any(wider),
        }
    }
}

/// The stored points of all pieces from one on, in their order.
pub(super) fn generate(pieces: &Pieces, stored: &[u32], from: usize) -> Vec<Point> {
    let count = stored.last().zip(stored.get(from)).map_or(0, |(end, begin)| end - begin);
    let mut points = vec![Point(0); count as usize];
    let mut parts = Vec::with_capacity(pieces.all.len() - from);
    let mut rest = points.as_mut_slice();
    for (number, piece) in pieces.all.iter().enumerate().skip(from) {
        let (part, others) = rest.split_at_mut((stored[number + 1] - stored[number]) as usize);
        rest = others;
        parts.push((number as u32, piece, part));
    }
    parts.into_par_iter().with_min_len(16).for_each(|(number, piece, part)| {
        for (point, [row, column]) in part.iter_mut().zip(piece.cells()) {
            *point = Point::new(number, row, column);
        }
    });
    points
}
