// Program of `sampler/src/passes/look_up_cells.rs`: light of the sky and of other surfaces for the texels of a tile, from light
// cells. `sampler/src/light/cells/lookup.rs` is the same on the CPU.

import package::shared::light_cells::{
    ALL_GROUPS, CellCorner, CellLevel, CellPage, GROUPS_UNKNOWN, LEAST_WEIGHT, MOST_LEVEL, MOST_UNFIT, MOST_UNFIT_BESIDE_WALL,
    NO_GROUPS, NO_PAGE, Weighed, cell_in, cell_number, cell_query, corner_at, corner_cells, groups_beside_wall, is_in_lattice,
    is_in_page, level_of, offset_of, page_of, weigh,
};
import package::shared::lit_texel::{LitTexel, index_of, texel_at, texel_count, tile};

// What is found of the cells of a tile: the most tiers that one of them lacks of three; the numbers of corners that lack, of texels
// without a surface and of texels that no cells describe; the most tiers that cells of finer levels lack; 1 if some of these lacked
// only at the lookup; and for each page whether it is used.
@group(0) @binding(3) var<storage, read_write> cell_outcome: array<atomic<u32>>;
// Corners that lack, by the number of their lowest cell.
@group(0) @binding(4) var<storage, read_write> lacking: array<vec2u>;
// The share of the sky that each texel sees, and irradiance / pi of other surfaces. In w 1 where a texel would stand out, and is joined
// with those around it.
@group(0) @binding(5) var<storage, read_write> sky_share: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> indirect: array<vec4f>;
// The texel itself where no cells describe it, NO_MEMBER elsewhere.
@group(0) @binding(7) var<storage, read_write> members: array<u32>;

const LACKS: u32 = 0;
const LACKING_COUNT: u32 = 1;
const NOTHING_COUNT: u32 = 2;
const ALONE_COUNT: u32 = 3;
const FINER_LACKS: u32 = 4;
const LATE: u32 = 5;
const FIRST_USED: u32 = 6;

const NO_MEMBER: u32 = 0xffffffffu;
const TIERS: u32 = 3;

// Kinds of what a lookup at a corner brings.
const LIGHT: u32 = 0;
const ALONE: u32 = 1;

struct Mixed {
    kind: u32,
    seen: vec3f,
    whole: vec3f,
    reflected: vec3f,
}

fn use_page(page: CellPage) {
    let at = FIRST_USED + page.listed - 1u;
    if page.listed > 0u && atomicLoad(&cell_outcome[at]) == 0u {
        atomicStore(&cell_outcome[at], 1u);
    }
}

// How many of three tiers a corner lacks.
fn lacks_of(corner: CellCorner) -> u32 {
    var page = NO_PAGE;
    var tiers = TIERS;
    for (var index = 0u; index < corner_cells(); index++) {
        let at = corner.cell + offset_of(index);
        if !is_in_page(page, corner.level, at) {
            page = page_of(corner.level, at);
            use_page(page);
        }
        let cell = cell_in(page, at);
        let has = select(cell.tiers, 0u, index == 0u && cell.groups == GROUPS_UNKNOWN);
        tiers = select(tiers, min(tiers, has), is_in_lattice(at));
    }
    return select(0u, TIERS - tiers, corner.exists);
}

fn same_corner(a: CellCorner, b: CellCorner) -> bool {
    return a.exists && b.exists && a.level == b.level && all(a.cell == b.cell);
}

// Notes what a corner lacks, unless it is that of a texel beside. `word`: LACKS or FINER_LACKS.
fn note_lack(corner: CellCorner, beside: CellCorner, lacks: u32, word: u32) {
    if lacks > atomicLoad(&cell_outcome[word]) {
        atomicMax(&cell_outcome[word], lacks);
    }
    if TIERS - lacks < cell_query.needed && !same_corner(corner, beside) {
        let place = atomicAdd(&cell_outcome[LACKING_COUNT], 1u);
        if place < arrayLength(&lacking) {
            lacking[place] = cell_number(corner.level, corner.cell);
        }
    }
}

// Finds which tier all cells of the tile have, and which cells lack.
@compute @workgroup_size(64)
fn survey(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    if at >= texel_count() {
        return;
    }
    let texel = texel_at(at);
    if !texel.exists {
        atomicAdd(&cell_outcome[NOTHING_COUNT], 1u);
        return;
    }
    let level = level_of(at, texel);
    // Corners that the texel to the left has, too, are noted there.
    let before = select(at, at - 1u, at % tile.size.x > 0u);
    let left = texel_at(before);
    let left_level = level_of(before, left);
    let has_left = at % tile.size.x > 0u && left.exists;
    var corner = corner_at(texel, level.whole);
    var beside = corner_at(left, left_level.whole);
    beside.exists = beside.exists && has_left;
    note_lack(corner, beside, lacks_of(corner), LACKS);
    if level.blend > 0.0 {
        corner = corner_at(texel, level.whole + 1u);
        beside = corner_at(left, left_level.whole + 1u);
        beside.exists = beside.exists && has_left && left_level.blend > 0.0;
        note_lack(corner, beside, lacks_of(corner), LACKS);
    }
}

// The best tier that all cells have of the texels' own levels, and of all levels.
fn first_tier() -> u32 {
    return min(cell_query.tier, TIERS - 1u - min(atomicLoad(&cell_outcome[LACKS]), TIERS - 1u));
}

fn found_tier() -> u32 {
    return min(first_tier(), TIERS - 1u - min(atomicLoad(&cell_outcome[FINER_LACKS]), TIERS - 1u));
}

fn groups_at(corner: CellCorner) -> u32 {
    return cell_in(page_of(corner.level, corner.cell), corner.cell).groups;
}

fn nothing_mixed(kind: u32) -> Mixed {
    return Mixed(kind, vec3f(0.0), vec3f(0.0), vec3f(0.0));
}

// The light of a texel at a corner: the mean of the sides that count there, unless that does not describe the texel.
fn mixed_at(texel: LitTexel, corner: CellCorner, tier: u32) -> Mixed {
    let groups = groups_at(corner);
    if !corner.exists || groups == GROUPS_UNKNOWN {
        return nothing_mixed(ALONE);
    }
    var kept = ALL_GROUPS;
    if groups != NO_GROUPS {
        kept = groups_beside_wall(texel, corner, groups, tier);
    }
    let sum = weigh(texel, corner, groups, tier, kept);
    let most_unfit = select(MOST_UNFIT_BESIDE_WALL, MOST_UNFIT, groups == NO_GROUPS);
    let describes = sum.fit > LEAST_WEIGHT && sum.unfit <= most_unfit * (sum.fit + sum.unfit);
    let each = select(0.0, 1.0 / sum.fit, describes);
    return Mixed(select(ALONE, LIGHT, describes), sum.seen * each, sum.whole * each, sum.reflected * each);
}

// The light of a texel at its level, and where it blends into the next, there.
struct OwnLevels {
    coarse: Mixed,
    fine: Mixed,
}

fn mixed_at_own(texel: LitTexel, level: CellLevel, tier: u32) -> OwnLevels {
    let coarse = mixed_at(texel, corner_at(texel, level.whole), tier);
    var fine = nothing_mixed(LIGHT);
    if level.blend > 0.0 {
        fine = mixed_at(texel, corner_at(texel, level.whole + 1u), tier);
    }
    return OwnLevels(coarse, fine);
}

// The finer level that is tried where cells of a texel's own levels do not describe it; 0 where they do, or where there is none.
fn finer_level(own: OwnLevels, level: CellLevel) -> u32 {
    let blends = level.blend > 0.0;
    let is_alone = select(own.coarse.kind, own.fine.kind, blends) == ALONE;
    let finer = level.whole + select(1u, 2u, blends);
    return select(0u, finer, is_alone && finer <= u32(MOST_LEVEL));
}

// Finds which tier the cells of finer levels have, where these are tried, and which of them lack.
@compute @workgroup_size(64)
fn survey_finer(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    // Before all cells of the own levels are there, nothing is known of the finer ones.
    if at >= texel_count() || TIERS - atomicLoad(&cell_outcome[LACKS]) < cell_query.needed {
        return;
    }
    let texel = texel_at(at);
    if !texel.exists {
        return;
    }
    let level = level_of(at, texel);
    let finer = finer_level(mixed_at_own(texel, level, first_tier()), level);
    if finer > 0u {
        let corner = corner_at(texel, finer);
        var nowhere = corner;
        nowhere.exists = false;
        note_lack(corner, nowhere, lacks_of(corner), FINER_LACKS);
    }
}

// Keeps the light of a texel.
fn keep(at: u32, light: Mixed, tier: u32) {
    let is_alone = light.kind != LIGHT;
    members[at] = select(NO_MEMBER, at, is_alone);
    if is_alone {
        atomicAdd(&cell_outcome[ALONE_COUNT], 1u);
    }
    let ratio = select(vec3f(0.0), light.seen / light.whole, light.whole > vec3f(0.0));
    // Cells of the fewest rays differ from one to the next.
    let stands_out = select(0.0, 1.0, is_alone || tier == 0u);
    sky_share[at] = vec4f(ratio, stands_out);
    indirect[at] = vec4f(light.reflected, stands_out);
}

// The light of a texel's own levels.
fn blended(own: OwnLevels, blend: f32) -> Mixed {
    if blend <= 0.0 {
        return own.coarse;
    }
    // The finer level is enough. A coarser one may reach behind walls that the finer one told from one another.
    let share = select(blend, 1.0, own.coarse.kind == ALONE);
    return Mixed(
        own.fine.kind, mix(own.coarse.seen, own.fine.seen, share), mix(own.coarse.whole, own.fine.whole, share),
        mix(own.coarse.reflected, own.fine.reflected, share),
    );
}

// Looks all texels up.
@compute @workgroup_size(64)
fn look_up(
    @builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let at = index_of(group, groups, lane);
    if at >= texel_count() {
        return;
    }
    let texel = texel_at(at);
    members[at] = NO_MEMBER;
    sky_share[at] = vec4f(0.0);
    indirect[at] = vec4f(0.0);
    if !texel.exists {
        return;
    }
    let level = level_of(at, texel);
    let tier = found_tier();
    let own = mixed_at_own(texel, level, tier);
    let finer = finer_level(own, level);
    var light = blended(own, level.blend);
    if finer > 0u {
        let corner = corner_at(texel, finer);
        // A lower tier than that of the survey can describe other texels.
        if TIERS - lacks_of(corner) <= tier {
            atomicStore(&cell_outcome[LATE], 1u);
        }
        light = mixed_at(texel, corner, tier);
    }
    keep(at, light, tier);
}
