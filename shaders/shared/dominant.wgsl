// The dominant surface of a texel, by the inverse ranges of its sub-samples on the texel's central ray.

// Two sub-samples show one surface if their inverse ranges differ by less than this share: then a warp that moves the
// texel by a hundred pixels misplaces neither by more than about one.
const SAME_SURFACE: f32 = 1.0 / 64.0;

// Most sub-samples of a texel.
const MOST_SUB_SAMPLES: u32 = 16u;

fn same_surface(a: f32, b: f32) -> bool {
    // Sky, which is 0, is one surface.
    return abs(a - b) <= SAME_SURFACE * max(a, b);
}

// The inverse range that most of the first `count` share; of equally shared ones, the nearest.
fn dominant(inverse: ptr<function, array<f32, MOST_SUB_SAMPLES>>, count: u32) -> f32 {
    var best = 0.0;
    var best_share = 0u;
    for (var i = 0u; i < count; i++) {
        var share = 0u;
        for (var j = 0u; j < count; j++) {
            share += select(0u, 1u, same_surface((*inverse)[i], (*inverse)[j]));
        }
        let better = share > best_share || (share == best_share && (*inverse)[i] > best);
        best = select(best, (*inverse)[i], better);
        best_share = select(best_share, share, better);
    }
    return best;
}
