// Reads and writes texels of the maps of many views. `papers/megaviews/src/many_views/texels.rs` decides their bits.
//
// A map has 2 side² texels (`paraboloid.wgsl`). Maps are stored in up to four arrays, since some devices limit a binding to
// 128 MiB. A texel has a code of the inverse range in its upper bits and a scene node in its lower bits, or only the code.
// A greater texel is nearer, and 0 is sky. Texels of 16 bits are stored in pairs, the first one in the lower half of a word.

// Number of arrays of maps.
override arrays: u32 = 1u;
// Bits of a texel: 64, 32 or 16.
override texel_bits: u32 = 64u;
// Whether texels name the visible node, and the bits of a node in texels of 32 bits.
override names_nodes: bool = true;
override node_bits: u32 = 0u;
// Dropped lower bits of an f32 inverse range. Codes of the least and the greatest inverse range, after dropping.
override dropped_bits: u32 = 0u;
override least_code: u32 = 1u;
override greatest_code: u32 = 0xffffffffu;

@group(1) @binding(0) var<storage, read_write> wide0: array<atomic<u64>>;
@group(1) @binding(1) var<storage, read_write> wide1: array<atomic<u64>>;
@group(1) @binding(2) var<storage, read_write> wide2: array<atomic<u64>>;
@group(1) @binding(3) var<storage, read_write> wide3: array<atomic<u64>>;
@group(1) @binding(4) var<storage, read_write> narrow0: array<atomic<u32>>;
@group(1) @binding(5) var<storage, read_write> narrow1: array<atomic<u32>>;
@group(1) @binding(6) var<storage, read_write> narrow2: array<atomic<u32>>;
@group(1) @binding(7) var<storage, read_write> narrow3: array<atomic<u32>>;

// Inverse range in 1/metres, 0 for sky; node, 0 if texels name none.
struct MapTexel {
    inverse_range: f32,
    node: u32,
}

// Array of a texel, and its index there. An array has 2^shift maps.
fn texel_place(map: u32, shift: u32, side: u32, texel: u32) -> vec2u {
    let array_ = map >> shift;
    return vec2u(array_, (map - (array_ << shift)) * side * side * 2u + texel);
}

// Encodes an inverse range, rounded down: never nearer than the value.
fn range_code(inverse_range: f32) -> u32 {
    let code = clamp(bitcast<u32>(inverse_range) >> dropped_bits, least_code, greatest_code) - least_code + 1u;
    return select(code, 0u, inverse_range == 0.0);
}

// Decodes an inverse range.
fn coded_range(code: u32) -> f32 {
    return select(bitcast<f32>((code - 1u + least_code) << dropped_bits), 0.0, code == 0u);
}

// A value in stored precision.
fn stored(value: MapTexel) -> MapTexel {
    return MapTexel(coded_range(range_code(value.inverse_range)), select(0u, value.node, names_nodes));
}

// Whether a stored value stays when another is written. The nearer stays; of equally near ones, the greater node.
fn stays(there: MapTexel, other: MapTexel) -> bool {
    let as_near = there.inverse_range == other.inverse_range && there.node >= other.node;
    return there.inverse_range > other.inverse_range || as_near;
}

// Writes a value to a texel, unless a nearer one is there.
fn put_texel(place: vec2u, value: MapTexel) {
    let code = range_code(value.inverse_range);
    if texel_bits == 64u {
        put_wide(place, (u64(code) << 32u) | u64(value.node));
    } else if texel_bits == 32u {
        put_narrow(place, (code << node_bits) | select(0u, value.node, names_nodes));
    } else {
        put_half(place, code);
    }
}

fn load_texel(place: vec2u) -> MapTexel {
    if texel_bits == 64u {
        let bits = load_wide(place);
        return MapTexel(coded_range(u32(bits >> 32u)), u32(bits & 0xfffffffflu));
    }
    if texel_bits == 32u {
        let bits = load_narrow(place);
        return MapTexel(coded_range(bits >> node_bits), bits & ((1u << node_bits) - 1u));
    }
    let half = 16u * (place.y & 1u);
    return MapTexel(coded_range((load_narrow(vec2u(place.x, place.y >> 1u)) >> half) & 0xffffu), 0u);
}

fn put_wide(place: vec2u, bits: u64) {
    if arrays == 1u || place.x == 0u {
        atomicMax(&wide0[place.y], bits);
    } else if arrays == 2u || place.x == 1u {
        atomicMax(&wide1[place.y], bits);
    } else if arrays == 3u || place.x == 2u {
        atomicMax(&wide2[place.y], bits);
    } else {
        atomicMax(&wide3[place.y], bits);
    }
}

fn load_wide(place: vec2u) -> u64 {
    if arrays == 1u || place.x == 0u {
        return atomicLoad(&wide0[place.y]);
    } else if arrays == 2u || place.x == 1u {
        return atomicLoad(&wide1[place.y]);
    } else if arrays == 3u || place.x == 2u {
        return atomicLoad(&wide2[place.y]);
    }
    return atomicLoad(&wide3[place.y]);
}

fn put_narrow(place: vec2u, bits: u32) {
    if arrays == 1u || place.x == 0u {
        atomicMax(&narrow0[place.y], bits);
    } else if arrays == 2u || place.x == 1u {
        atomicMax(&narrow1[place.y], bits);
    } else if arrays == 3u || place.x == 2u {
        atomicMax(&narrow2[place.y], bits);
    } else {
        atomicMax(&narrow3[place.y], bits);
    }
}

fn load_narrow(place: vec2u) -> u32 {
    if arrays == 1u || place.x == 0u {
        return atomicLoad(&narrow0[place.y]);
    } else if arrays == 2u || place.x == 1u {
        return atomicLoad(&narrow1[place.y]);
    } else if arrays == 3u || place.x == 2u {
        return atomicLoad(&narrow2[place.y]);
    }
    return atomicLoad(&narrow3[place.y]);
}

// There are no 16-bit atomics, and a maximum of the whole word would change the other half. So a half is written by
// compare-exchange and retried if the word has changed. Halves only grow, so the result is the maximum in any order of
// writes.
fn put_half(place: vec2u, code: u32) {
    let word = vec2u(place.x, place.y >> 1u);
    let half = 16u * (place.y & 1u);
    var there = load_narrow(word);
    while ((there >> half) & 0xffffu) < code {
        there = exchange(word, there, (there & ~(0xffffu << half)) | (code << half));
    }
}

// Replaces the word `before` by `after`, unless it changed. Returns the word that is there afterwards.
fn exchange(place: vec2u, before: u32, after: u32) -> u32 {
    if arrays == 1u || place.x == 0u {
        let found = atomicCompareExchangeWeak(&narrow0[place.y], before, after);
        return select(found.old_value, after, found.exchanged);
    } else if arrays == 2u || place.x == 1u {
        let found = atomicCompareExchangeWeak(&narrow1[place.y], before, after);
        return select(found.old_value, after, found.exchanged);
    } else if arrays == 3u || place.x == 2u {
        let found = atomicCompareExchangeWeak(&narrow2[place.y], before, after);
        return select(found.old_value, after, found.exchanged);
    }
    let found = atomicCompareExchangeWeak(&narrow3[place.y], before, after);
    return select(found.old_value, after, found.exchanged);
}
