// Position of a packet: the block of sub-samples that a subgroup traces together.

import package::shared::trace::found::Lane;
import package::shared::trace::pyramid::{Block, rays};

// A packet and one of its lanes. The packets of a workgroup are below one another. Together they cover 8 columns and
// 8 × `rows_of_lane` rows, for every subgroup size.
struct Packet {
    block: Block,
    lane: Lane,
    // Position of the lane's first sub-sample in the tile, and rows to its next one.
    at: vec2u,
    step: u32,
}

fn packet_at(group: vec3u, subgroup: u32, size: u32, index: u32, rows_of_lane: u32) -> Packet {
    let tall = min(size, 64u) / 8u;
    let begin = vec2u(group.x * 8u, (group.y * 8u + subgroup * tall) * rows_of_lane);
    let place = vec2u(index % 8u, index / 8u);
    return Packet(
        Block(vec2f(begin) + 0.5, vec2f(7.0, f32(tall * rows_of_lane) - 1.0)),
        Lane(index, vec2f(place), f32(tall)), begin + place, tall,
    );
}

// Whether a sub-sample is inside the tile.
fn is_inside(at: vec2u) -> bool {
    return at.x < rays.width && at.y < rays.height;
}
