// The stack of a ray's walk: groups of children that wait, one for each level of the trees.

// Most entries: the host builds no deeper trees.
const MOST_ENTRIES: u32 = 48;

struct Stack {
    entries: array<vec2u, MOST_ENTRIES>,
    height: u32,
}

fn push(stack: ptr<function, Stack>, entry: vec2u) {
    (*stack).entries[(*stack).height] = entry;
    (*stack).height += 1u;
}

// The uppermost entry of a stack that is not empty.
fn pop(stack: ptr<function, Stack>) -> vec2u {
    (*stack).height -= 1u;
    return (*stack).entries[(*stack).height];
}
