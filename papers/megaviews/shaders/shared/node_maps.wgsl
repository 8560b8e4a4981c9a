// Reads maps of octree nodes, which `papers/megaviews/src/many_views` renders with texels of 64 bits.

// Number of arrays of maps.
override arrays: u32 = 1u;

// A word a view: the index of its map.
@group(0) @binding(8) var<storage, read> map_of_view: array<u32>;
// Node and inverse range (f32 bits; 0 for none) of each texel.
@group(0) @binding(10) var<storage, read> maps0: array<vec2u>;
@group(0) @binding(11) var<storage, read> maps1: array<vec2u>;
@group(0) @binding(12) var<storage, read> maps2: array<vec2u>;
@group(0) @binding(13) var<storage, read> maps3: array<vec2u>;

fn map_of(view: u32) -> u32 {
    return map_of_view[min(view, arrayLength(&map_of_view) - 1u)];
}

// A texel of a map of `side`² texels a hemisphere. An array has 2^shift maps.
fn node_texel(map: u32, shift: u32, side: u32, texel: u32) -> vec2u {
    let array_ = map >> shift;
    let at = (map - (array_ << shift)) * 2u * side * side + texel;
    if arrays == 1u || array_ == 0u {
        return maps0[min(at, arrayLength(&maps0) - 1u)];
    } else if arrays == 2u || array_ == 1u {
        return maps1[min(at, arrayLength(&maps1) - 1u)];
    } else if arrays == 3u || array_ == 2u {
        return maps2[min(at, arrayLength(&maps2) - 1u)];
    }
    return maps3[min(at, arrayLength(&maps3) - 1u)];
}
