// Texels of the maps of many views, and how they are written.
//
// A map has 2 side² texels (`paraboloid.wgsl`), and maps lie one after the other in up to four arrays, since one binding
// ends at 128 MiB on some devices. A texel is inverse range (f32 bits, 1/metres, 0 where nothing was seen) over the
// number of the scene's node, or inverse range alone; either way the greater is the nearer.

// Whether texels are 64 bits wide, inverse range over node, rather than 32 of inverse range.
override wide: bool = true;
// Arrays that maps are spread over.
override arrays: u32 = 1u;

@group(1) @binding(0) var<storage, read_write> wide0: array<atomic<u64>>;
@group(1) @binding(1) var<storage, read_write> wide1: array<atomic<u64>>;
@group(1) @binding(2) var<storage, read_write> wide2: array<atomic<u64>>;
@group(1) @binding(3) var<storage, read_write> wide3: array<atomic<u64>>;
@group(1) @binding(4) var<storage, read_write> narrow0: array<atomic<u32>>;
@group(1) @binding(5) var<storage, read_write> narrow1: array<atomic<u32>>;
@group(1) @binding(6) var<storage, read_write> narrow2: array<atomic<u32>>;
@group(1) @binding(7) var<storage, read_write> narrow3: array<atomic<u32>>;

struct MapTexel {
    inverse_range: f32,
    node: u32,
}

// Where a texel lies: which array, and its index there; maps of one array are 2 to the power of `shift`.
fn texel_place(map: u32, shift: u32, side: u32, texel: u32) -> vec2u {
    let array_ = map >> shift;
    return vec2u(array_, (map - (array_ << shift)) * side * side * 2u + texel);
}

// The nearer of what is there and what is given stays.
fn put_texel(place: vec2u, value: MapTexel) {
    if wide {
        let bits = (u64(bitcast<u32>(value.inverse_range)) << 32u) | u64(value.node);
        if arrays == 1u || place.x == 0u {
            atomicMax(&wide0[place.y], bits);
        } else if arrays == 2u || place.x == 1u {
            atomicMax(&wide1[place.y], bits);
        } else if arrays == 3u || place.x == 2u {
            atomicMax(&wide2[place.y], bits);
        } else {
            atomicMax(&wide3[place.y], bits);
        }
    } else {
        let bits = bitcast<u32>(value.inverse_range);
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
}

fn load_texel(place: vec2u) -> MapTexel {
    if wide {
        var bits = 0lu;
        if arrays == 1u || place.x == 0u {
            bits = atomicLoad(&wide0[place.y]);
        } else if arrays == 2u || place.x == 1u {
            bits = atomicLoad(&wide1[place.y]);
        } else if arrays == 3u || place.x == 2u {
            bits = atomicLoad(&wide2[place.y]);
        } else {
            bits = atomicLoad(&wide3[place.y]);
        }
        return MapTexel(bitcast<f32>(u32(bits >> 32u)), u32(bits & 0xfffffffflu));
    }
    var bits = 0u;
    if arrays == 1u || place.x == 0u {
        bits = atomicLoad(&narrow0[place.y]);
    } else if arrays == 2u || place.x == 1u {
        bits = atomicLoad(&narrow1[place.y]);
    } else if arrays == 3u || place.x == 2u {
        bits = atomicLoad(&narrow2[place.y]);
    } else {
        bits = atomicLoad(&narrow3[place.y]);
    }
    return MapTexel(bitcast<f32>(bits), 0u);
}
