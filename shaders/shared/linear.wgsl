// A linear index for each invocation of a two-dimensional dispatch of workgroups of 64. One dimension has at most 65,535
// workgroups, and an indirect dispatch of more runs none.

const LINEAR_GROUP: u32 = 64u;

fn linear_index(group: vec3u, groups: vec3u, local: u32) -> u32 {
    return (group.y * groups.x + group.x) * LINEAR_GROUP + local;
}
