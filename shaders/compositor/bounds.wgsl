// Program of compositor/src/passes/bounds.rs: the least and greatest inverse range of each tile of a sample. With them
// the host culls tiles outside a view.

struct TileBounds {
    face_offset: vec2u,
    face_size: vec2u,
    layer: u32,
    first_tile: u32,
    tile_columns: u32,
    tile_rows: u32,
    // Texels on a side of a tile.
    tile_side: u32,
}

var<immediate> face: TileBounds;

@group(0) @binding(0) var inverse_range: texture_2d_array<f32>;
// Least and greatest inverse range of each tile; 0 and 0 for a tile without surfaces.
@group(0) @binding(1) var<storage, read_write> tiles: array<vec2f>;

@compute @workgroup_size(8, 8)
fn bound_tile(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= face.tile_columns || id.y >= face.tile_rows {
        return;
    }
    var least = 0.0;
    var most = 0.0;
    let side = face.tile_side;
    // Quirk: uniform-bound.
    for (var i = 0u; i < min(side * side, arrayLength(&tiles) * 0x1000u); i++) {
        let texel = id.xy * side + vec2u(i % side, i / side);
        let inside = all(texel < face.face_size);
        let stored = textureLoad(inverse_range, face.face_offset + min(texel, face.face_size - 1u), face.layer, 0).x;
        // Positive, finite and not NaN, by its bits. Quirk: folded-nan.
        if inside && (bitcast<u32>(stored) - 1u) < 0x7f7fffffu {
            least = select(min(least, stored), stored, least == 0.0);
            most = max(most, stored);
        }
    }
    tiles[face.first_tile + id.y * face.tile_columns + id.x] = vec2f(least, most);
}
