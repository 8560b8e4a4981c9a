// Virtual point lights: what passes that gather their light are told.

// Most groups of VPLs that a block's list holds.
const MOST_GROUPS: u32 = 256u;
// Words of a list: how many groups, how many VPLs, the sum of what groups are worth (f32); then for each group its
// first VPL, the number of VPLs up to its last, the sum of worth up to its own (f32), and for how many like it it
// stands (f32).
const LIST_HEAD: u32 = 3u;
const GROUP_WORDS: u32 = 4u;
const LIST_WORDS: u32 = LIST_HEAD + GROUP_WORDS * MOST_GROUPS;
// Sub-samples on a side of a block that shares a list.
const BLOCK: u32 = 16u;

// Positions are relative to the root, the middle of the scene.
struct Vpl {
    position: vec3f,
    // Unit normal, by whose cosine light leaves; zero for a particle, from which it leaves everywhere.
    normal: vec3f,
    // Flux by π², of a particle by 4π², so that a sum of cosines by squared distance is irradiance by π.
    intensity: vec3f,
}

struct VplNode {
    // A ball around the positions.
    center: vec3f,
    radius: f32,
    // A cone around the normals: the cosine of its half angle is -1 where they face everywhere.
    axis: vec3f,
    cosine: f32,
    // The run of VPLs.
    first: u32,
    count: u32,
    // The node after all that are below this one.
    skip: u32,
    leaf: u32,
    // Sum of the intensities, mean of the channels.
    power: f32,
}

struct Gathering {
    root_from_eye: vec3f,
    // VPLs that a sub-sample gathers from.
    samples: u32,
    // Blocks of the tile: columns, rows.
    blocks: vec2u,
    // Sub-samples of the tile.
    size: vec2u,
    // Where the tile begins in the image, sub-samples.
    origin: vec2u,
    // Texels on a side of a hemisphere's map.
    map_side: u32,
    // Maps of one array: 2 to the power of this.
    map_shift: u32,
    // Sub-samples that the filter reaches on each side.
    reach: u32,
    // Metres: nearer than this no VPL lights more strongly.
    least_distance: f32,
    // Metres: farther than this no VPL lights.
    cutoff: f32,
    // Widths of a texel.
    bias: f32,
    // Metres by which the maps' surfaces may lie before the true ones.
    slack: f32,
    // Whether groups are left out.
    culls: u32,
    // Whether groups are chosen by what they are worth rather than by how many VPLs they have.
    weighs: u32,
    // Groups that a block keeps on average; 0 for all that may light it.
    kept_groups: u32,
}
