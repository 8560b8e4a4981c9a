// Light cells on a device: pages of filled cells, and what lies around a corner of the lattice. `sampler/src/light/cells/lookup.rs`
// is the same on the CPU.

import package::shared::encode::unit_from_octahedral;
import package::shared::lit_texel::LitTexel;

// What is asked of cells.
struct CellQuery {
    // Edge of a cell of level 0, metres; edge of a cell by the distance at which it is seen.
    edge: f32,
    edge_by_distance: f32,
    // Edge of a cell by the side of the area that a texel stands for.
    edge_by_side: f32,
    // The best tier that is asked for, and the number of tiers that all cells must have.
    tier: u32,
    needed: u32,
}

// The eye in the cells of a level.
struct CellEye {
    // Its cell.
    cell: vec3i,
    // 1 if it is near enough to the lattice.
    exists: u32,
    // Its place within the cell, and the cell's edge in metres.
    within: vec3f,
    spacing: f32,
}

@group(2) @binding(5) var<uniform> cell_query: CellQuery;
@group(2) @binding(6) var<storage, read> cell_eyes: array<CellEye>;
// Pages with open addressing: the number of the page (two words), the first vector of its block in `cell_data`, and 1 + the page's
// place in the list of pages; the last is 0 if the slot is free.
@group(2) @binding(7) var<storage, read> page_table: array<vec4u>;
// A block a page: `sampler/src/light/cells/store/hot.rs`. First two words for each of 512 cells: its first side in the block,
// in vectors (bits 5 to 31), the number of its sides (2 to 4) and of its tiers (0 to 1); and of the corner at it, the first
// vector of its groups in the block, 1 if it has none, 0 if that is not known. Then sides of three vectors, tier by tier.
@group(2) @binding(8) var<storage, read> cell_data: array<vec4u>;

// Mean side of the area that each texel stands for, metres; 0 if that is what a pixel shows from the eye.
@group(2) @binding(9) var<storage, read> cell_across: array<f32>;

// Whether texels stand for other areas than what pixels show; otherwise `cell_across` is not read.
override has_across: bool = false;

// Cells on each side of the lattice's origin, and the finest level.
const LATTICE_REACH: i32 = 262144;
const MOST_LEVEL: f32 = 16.0;
// Share of a level in which it blends into the next; least cosine between view and surface that spacing follows.
const BLEND: f32 = 0.3;
const LEAST_COSINE: f32 = 0.05;
// Falloff with the squared distance from a side's plane.
const PLANE: f32 = 1.2;
const LEAST_WEIGHT: f32 = 0.02;
// Shares of unfit sides from which on the others do not describe a texel: in the open, and beside a wall.
const MOST_UNFIT: f32 = 0.5;
const MOST_UNFIT_BESIDE_WALL: f32 = 0.1;
// Blocked ways between a side's origins up to which no wall stands between them.
const MOST_BLOCKED: u32 = 2;
// Rays of the tiers' sides.
const FIRST_RAYS: f32 = 16.0;
// All groups of sides.
const ALL_GROUPS: u32 = 0xffffffffu;

// The level of a texel, and the share of the next finer one.
struct CellLevel {
    whole: u32,
    blend: f32,
}

fn level_of(at: u32, texel: LitTexel) -> CellLevel {
    let distance = length(texel.position);
    let cosine = max(abs(dot(texel.side, texel.position)) / distance, LEAST_COSINE);
    var spacing = cell_query.edge_by_distance * distance / sqrt(cosine);
    if has_across {
        let across = cell_across[at];
        spacing = select(spacing, cell_query.edge_by_side * across, across > 0.0);
    }
    let level = clamp(log2(cell_query.edge / spacing), 0.0, MOST_LEVEL);
    let whole = floor(level);
    let blend = select(0.0, (level - whole - (1.0 - BLEND)) / BLEND, whole < MOST_LEVEL);
    return CellLevel(u32(whole), max(blend, 0.0));
}

// The eight cells around a texel on a level.
struct CellCorner {
    // False beyond the lattice.
    exists: bool,
    level: u32,
    // The lowest cell.
    cell: vec3i,
    // The texel from its lowest corner, in edges of a cell: 0.5 to 1.5.
    place: vec3f,
}

fn is_in_lattice(cell: vec3i) -> bool {
    return all(cell >= vec3i(-LATTICE_REACH)) && all(cell < vec3i(LATTICE_REACH));
}

fn corner_at(texel: LitTexel, level: u32) -> CellCorner {
    let eye = cell_eyes[min(level, 16u)];
    let place = texel.position / eye.spacing + eye.within;
    let base = floor(place - 0.5);
    let cell = eye.cell + vec3i(clamp(base, vec3f(-2e6), vec3f(2e6)));
    return CellCorner(eye.exists == 1u && is_in_lattice(cell), level, cell, place - base);
}

// The number of a cell: `CellKey` of `sampler/src/light/lattice.rs`.
fn cell_number(level: u32, cell: vec3i) -> vec2u {
    let at = vec3u(cell + LATTICE_REACH);
    return vec2u(at.x | (at.y << 19u), (at.y >> 13u) | (at.z << 6u) | (level << 25u));
}

// A page: the first vector of its block, and 1 + its place in the list; 0 if it is not held.
struct CellPage {
    number: vec2u,
    first: u32,
    listed: u32,
}

const NO_PAGE: CellPage = CellPage(vec2u(0xffffffffu), 0u, 0u);

// The first slot at which a page is looked for: `slot_of` of `sampler/src/light/cells/mirror.rs`.
fn page_slot(number: vec2u) -> u32 {
    let mixed = (number.x * 0x9e3779b1u) ^ (number.y * 0x85ebca6bu);
    return mixed ^ (mixed >> 15u);
}

fn page_of(level: u32, cell: vec3i) -> CellPage {
    let number = cell_number(level, (cell >> vec3u(3u)) << vec3u(3u));
    let mask = arrayLength(&page_table) - 1u;
    var slot = page_slot(number) & mask;
    var found = page_table[slot];
    while found.w != 0u && any(found.xy != number) {
        // One turn too many changes nothing. Quirk: loop-body-once.
        slot = select(slot, (slot + 1u) & mask, found.w != 0u && any(found.xy != number));
        found = page_table[slot];
    }
    return CellPage(number, found.z, found.w);
}

// Whether a cell is in a page that is at hand.
fn is_in_page(page: CellPage, level: u32, cell: vec3i) -> bool {
    return all(page.number == cell_number(level, (cell >> vec3u(3u)) << vec3u(3u)));
}

// A filled cell: its first side, as a vector of `cell_data`, the numbers of sides and tiers, and the first vector of the groups
// of the corner at it (NO_GROUPS, GROUPS_UNKNOWN).
struct FilledCell {
    first: u32,
    sides: u32,
    tiers: u32,
    groups: u32,
}

const GROUPS_UNKNOWN: u32 = 0;
const NO_GROUPS: u32 = 1;

fn cell_in(page: CellPage, cell: vec3i) -> FilledCell {
    if page.listed == 0u {
        return FilledCell(0u, 0u, 0u, GROUPS_UNKNOWN);
    }
    let inside = vec3u(cell & vec3i(7));
    let place = inside.x | (inside.y << 3u) | (inside.z << 6u);
    let pair = cell_data[page.first + place / 2u];
    let words = select(pair.xy, pair.zw, (place & 1u) == 1u);
    let groups = select(words.y, page.first + words.y, words.y > NO_GROUPS);
    return FilledCell(page.first + (words.x >> 5u), (words.x >> 2u) & 7u, words.x & 3u, groups);
}

fn offset_of(index: u32) -> vec3i {
    return (vec3i(i32(index)) >> vec3u(0u, 1u, 2u)) & vec3i(1);
}

// Cells of a corner. The bound of loops over them is no constant. Quirk: unrolled-loops.
fn corner_cells() -> u32 {
    return min(8u, arrayLength(&cell_data));
}

// The group of a corner's side, by its number among all sides of the corner.
fn group_of(groups: u32, number: u32) -> u32 {
    let words = cell_data[groups + number / 16u];
    return (words[(number / 4u) % 4u] >> (number % 4u * 8u)) & 255u;
}

// A side of a cell.
struct CellSide {
    // Mean point from the cell's lowest corner, in edges of the cell.
    place: vec3f,
    normal: vec3f,
    is_thin: bool,
    blocked: u32,
    // Number of its rays that count.
    valid: f32,
}

fn side_at(first: u32) -> CellSide {
    let words = cell_data[first].xyz;
    let place = vec3f(vec3u(words.x & 0xffffu, words.x >> 16u, words.y & 0xffffu)) / 65535.0;
    let marks = words.y >> 16u;
    return CellSide(
        place, unit_from_octahedral(unpack2x16snorm(words.z)), (marks & 0x2000u) != 0u, (marks >> 9u) & 15u,
        f32(marks & 511u),
    );
}

// How alike a side and a texel face, and how near the texel is to its plane: 0 to 1. `offset`: of its cell from the corner's lowest.
fn side_likeness(texel: LitTexel, place: vec3f, offset: vec3f, side: CellSide) -> f32 {
    let facing = max(dot(texel.normal, side.normal), 0.0);
    let off = dot(place - offset - side.place, texel.side);
    let plane = max(1.0 - PLANE * off * off, 0.0);
    let squared = facing * facing;
    return (squared * squared) * (plane * plane);
}

// How much a side of a cell counts at a texel.
fn side_weight(texel: LitTexel, place: vec3f, offset: vec3f, side: CellSide, tier: u32) -> f32 {
    let across = place - 0.5;
    let near = 1.0 - across + offset * (2.0 * across - 1.0);
    let share = side.valid / (FIRST_RAYS * f32(1u << (2u * tier)));
    return near.x * near.y * near.z * side_likeness(texel, place, offset, side) * (share * share);
}

// The groups that a texel beside a wall takes, a bit each: those on its side of the wall, as the side is that it lies on. 0 if there is
// no such side, or if it reaches through the wall.
fn groups_beside_wall(texel: LitTexel, corner: CellCorner, corner_groups: u32, tier: u32) -> u32 {
    let home = vec3i(floor(corner.place));
    var page = NO_PAGE;
    var number = 0u;
    var most = 0.0;
    var kept = 0u;
    for (var index = 0u; index < corner_cells(); index++) {
        let offset = offset_of(index);
        let at = corner.cell + offset;
        if !is_in_page(page, corner.level, at) {
            page = page_of(corner.level, at);
        }
        var cell = cell_in(page, at);
        cell.sides = select(0u, cell.sides, cell.tiers > tier && is_in_lattice(at));
        for (var side_index = 0u; side_index < cell.sides; side_index++) {
            // Quirk: loop-body-once.
            if side_index < cell.sides {
                let side = side_at(cell.first + 3u * (tier * cell.sides + side_index));
                let group = group_of(corner_groups, number);
                number += 1u;
                let likeness = side_likeness(texel, corner.place, vec3f(offset), side);
                let is_here = all(offset == home) && side.valid > 0.0 && likeness > 0.0;
                if is_here && likeness >= most {
                    most = likeness;
                    let groups = select(1u | (1u << group), ALL_GROUPS, group == 0u);
                    kept = select(groups, 0u, side.is_thin || side.blocked > 0u);
                }
            }
        }
    }
    return kept;
}

// Sums over sides at a texel, by weight.
struct Weighed {
    seen: vec3f,
    whole: vec3f,
    reflected: vec3f,
    fit: f32,
    unfit: f32,
}

fn nothing_weighed() -> Weighed {
    return Weighed(vec3f(0.0), vec3f(0.0), vec3f(0.0), 0.0, 0.0);
}

// Weighs the sides of a corner whose group is one of `groups`, a bit each.
fn weigh(texel: LitTexel, corner: CellCorner, corner_groups: u32, tier: u32, groups: u32) -> Weighed {
    var sum = nothing_weighed();
    var page = NO_PAGE;
    var number = 0u;
    let most_blocked = select(0u, MOST_BLOCKED, corner_groups == NO_GROUPS);
    for (var index = 0u; index < corner_cells(); index++) {
        let offset = offset_of(index);
        let at = corner.cell + offset;
        if !is_in_page(page, corner.level, at) {
            page = page_of(corner.level, at);
        }
        var cell = cell_in(page, at);
        // Cells beyond the lattice are left out.
        cell.sides = select(0u, cell.sides, cell.tiers > tier && is_in_lattice(at));
        for (var side_index = 0u; side_index < cell.sides; side_index++) {
            let first = cell.first + 3u * (tier * cell.sides + side_index);
            let side = side_at(first);
            var group = 0u;
            if corner_groups > NO_GROUPS {
                group = group_of(corner_groups, number);
            }
            number += 1u;
            let weight = side_weight(texel, corner.place, vec3f(offset), side, tier);
            // Quirk: loop-body-once.
            let counts = select(0.0, weight, ((groups >> group) & 1u) == 1u && side_index < cell.sides);
            if side.is_thin || side.blocked > most_blocked {
                sum.unfit += counts;
            } else {
                let rest = bitcast<vec4f>(cell_data[first + 1u]);
                let last = bitcast<vec4f>(cell_data[first + 2u]);
                sum.fit += counts;
                sum.seen += counts * vec3f(bitcast<f32>(cell_data[first].w), rest.xy);
                sum.whole += counts * vec3f(rest.zw, last.x);
                sum.reflected += counts * last.yzw;
            }
        }
    }
    return sum;
}
