// Virtual point lights (VPLs), and parameters of the passes that gather their light.

// Most groups of VPLs in a block's list.
const MOST_GROUPS: u32 = 256u;
// Words of a list. Head: number of groups, number of VPLs, sum of the groups' weights (f32 bits). Then for each group: its
// first VPL; number of VPLs up to its last one; sum of weights up to its own (f32 bits); number of similar groups that it
// represents (f32 bits).
const LIST_HEAD: u32 = 3u;
const GROUP_WORDS: u32 = 4u;
const LIST_WORDS: u32 = LIST_HEAD + GROUP_WORDS * MOST_GROUPS;
// Sub-samples on a side of a block that shares a list.
const BLOCK: u32 = 16u;

// A virtual point light. Positions are relative to the centre of the scene.
struct Vpl {
    position: vec3f,
    // Unit normal of a cosine-weighted emitter; zero for a particle, which emits in all directions.
    normal: vec3f,
    // Flux / π², of a particle flux / 4π². The sum of intensity · cosines / distance² is thus irradiance / π.
    intensity: vec3f,
}

// A node of the tree over VPLs.
struct VplNode {
    // Bounding sphere of the positions.
    center: vec3f,
    radius: f32,
    // Bounding cone of the normals. The cosine of its half angle is -1 if it holds all directions.
    axis: vec3f,
    cosine: f32,
    // First VPL and number of VPLs; they are contiguous.
    first: u32,
    count: u32,
    // The next node after all descendants of this one.
    skip: u32,
    // 1: a leaf.
    leaf: u32,
    // Sum of the intensities, averaged over the channels.
    power: f32,
}

// Parameters of the passes that gather light from VPLs.
struct Gathering {
    // Vector from the centre of the scene to the eye, metres: added to positions relative to the eye.
    root_from_eye: vec3f,
    // VPLs that each sub-sample gathers from.
    samples: u32,
    // Columns and rows of the tile's blocks.
    blocks: vec2u,
    // Columns and rows of the tile, sub-samples.
    size: vec2u,
    // Position of the tile in the image, sub-samples.
    origin: vec2u,
    // Texels on a side of a hemisphere's map.
    map_side: u32,
    // Base-2 logarithm of the number of maps in one array.
    map_shift: u32,
    // Radius of the filter, sub-samples.
    reach: u32,
    // Distance in metres below which a VPL's light is clamped.
    least_distance: f32,
    // Distance in metres beyond which a VPL has no effect.
    cutoff: f32,
    // Depth bias of shadow maps, in widths of a texel.
    bias: f32,
    // Metres by which surfaces in the maps may be in front of the true ones.
    slack: f32,
    // 1: groups that cannot light a block are culled.
    culls: u32,
    // 1: groups are drawn by their estimated light; 0: by their number of VPLs.
    weighs: u32,
    // Average number of groups in a block's list; 0: all groups that may light it.
    kept_groups: u32,
}
