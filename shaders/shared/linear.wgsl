// One invocation a number, over workgroups of 64 in two dimensions: one dimension ends at 65,535 workgroups, and an
// indirect dispatch beyond that runs none at all.

const LINEAR_GROUP: u32 = 64u;

fn linear_index(group: vec3u, groups: vec3u, local: u32) -> u32 {
    return (group.y * groups.x + group.x) * LINEAR_GROUP + local;
}
