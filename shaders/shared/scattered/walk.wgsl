// The walk of a ray through the trees, nearest places first: as in "Efficient Incoherent Ray Traversal on GPUs Through
// Compressed Wide BVHs" (Ylitie, Karras and Laine, 2017). It needs one entry of the stack a level.

import package::shared::scattered::stack::{Stack, pop, push};
import package::shared::scattered::mask::{hidden_share, threshold};
import package::shared::scattered::node::{NO_OBJECT, Opened, ROOT_WAITS, WAITING, open};
import package::shared::scattered::ray::{
    RAY_OF_SIGHT, TreeRay, exponent_of, query, ray_in_object, rays, scaled_direction, tree_ray, unit_of,
};
import package::shared::scattered::trees::{
    CUTOUT, GLASS, GLASS_IN_PARTS, MIRRORED, OF_TRIANGLE, ONE_SIDED, RECORD_SHIFT, placed, triangles,
};
import package::shared::scattered::triangle::{Met, meet};

// Constants of the scene: whether there are several placed objects, whether some surface has a mask, and whether some
// surface hides a part of what is behind it.
override has_objects: bool = true;
override has_masks: bool = true;
override has_transparent: bool = true;

const NO_TRIANGLE: u32 = 0xffffffffu;
// `Walk.floor` outside of objects.
const NO_FLOOR: u32 = 0xffffffffu;
// Beyond all finite distances.
const FAR: f32 = 3e38;

// What a ray has found so far.
struct Found {
    // Distance to the nearest hit, or where the ray ends, in units of the scaled direction.
    limit: f32,
    // The triangle that was hit, or NO_TRIANGLE; with its placed object.
    triangle: u32,
    object: u32,
    // Weights of the mesh's second and third corner.
    weights: vec2f,
    front: bool,
    // The share of light that passes.
    passed: f32,
}

// Where a ray is.
struct Walk {
    ray: TreeRay,
    // Children that wait: see `Opened`.
    group: vec2u,
    // Index of the placed object whose tree is walked.
    object: u32,
    // Height of the stack at which the walk of that object began, or NO_FLOOR in the tree over placed objects.
    floor: u32,
}

fn enter_object(index: u32, object: u32, floor: u32) -> Walk {
    let ray = rays[index];
    let direction = scaled_direction(ray.direction, exponent_of(ray.direction));
    let group = vec2u(placed[object].root, ROOT_WAITS);
    return Walk(ray_in_object(placed[object], ray.origin, direction), group, object, floor);
}

// The ray in the tree over placed objects.
fn top_ray(index: u32) -> TreeRay {
    let ray = rays[index];
    let direction = scaled_direction(ray.direction, exponent_of(ray.direction));
    return tree_ray(ray.origin, direction, query.min, query.max);
}

fn begin_walk(index: u32) -> Walk {
    if has_objects {
        return Walk(top_ray(index), vec2u(0u, ROOT_WAITS), 0u, NO_FLOOR);
    }
    return enter_object(index, 0u, 0u);
}

fn nothing_found(index: u32) -> Found {
    let ray = rays[index];
    let limit = min(ray.most * unit_of(exponent_of(ray.direction)), FAR);
    return Found(limit, NO_TRIANGLE, 0u, vec2f(0.0), false, 1.0);
}

// Instance of a triangle of a placed object.
fn instance_of(own: u32, object: u32) -> u32 {
    return select(own, placed[object].instance, own == OF_TRIANGLE);
}

// Tests a triangle. `ends`: any hit ends the walk, and is counted in `passed`. Returns whether the walk ends.
fn take(walk: ptr<function, Walk>, triangle: u32, flags: u32, ends: bool, found: ptr<function, Found>) -> bool {
    let a = triangles[3u * triangle];
    let b = triangles[3u * triangle + 1u];
    let c = triangles[3u * triangle + 2u];
    let met = meet((*walk).ray, bitcast<vec3f>(a.xyz), bitcast<vec3f>(b.xyz), bitcast<vec3f>(c.xyz));
    if !(met.inside && met.t > 0.0 && met.t < (*found).limit) {
        return false;
    }
    let of_sight = (flags & RAY_OF_SIGHT) != 0u;
    let passes_backs = of_sight && (c.w & ONE_SIDED) != 0u && !met.front;
    if passes_backs || (!of_sight && (c.w & GLASS) != 0u) {
        return false;
    }
    let weights = select(met.weights, met.weights.yx, (c.w & MIRRORED) != 0u);
    if has_masks && (c.w & select(CUTOUT | GLASS_IN_PARTS, CUTOUT, of_sight)) != 0u {
        let hidden = hidden_share(c.w >> RECORD_SHIFT, weights, !of_sight);
        if has_transparent && ends {
            (*found).passed *= 1.0 - hidden;
            return (*found).passed == 0.0;
        }
        if hidden <= 0.0 {
            return false;
        }
        if has_transparent && hidden < 1.0 && threshold(instance_of(a.w, (*walk).object), b.w, weights) >= hidden {
            return false;
        }
    }
    if ends {
        (*found).passed = 0.0;
        return true;
    }
    *found = Found(met.t, triangle, (*walk).object, weights, met.front, 0.0);
    return false;
}

// One step: opens the nearest waiting node and tests the triangles of its leaves, then chooses what waits next. Returns
// whether the walk goes on.
fn go_on(
    walk: ptr<function, Walk>, ray: u32, flags: u32, ends: bool, stack: ptr<function, Stack>,
    found: ptr<function, Found>,
) -> bool {
    let group = (*walk).group;
    let bit = firstLeadingBit(group.y);
    let others = group.y & ~(1u << bit);
    if (others & WAITING) != 0u {
        push(stack, vec2u(group.x, others));
    }
    let place = (bit ^ (*walk).ray.ascends) & 7u;
    let index = group.x + countOneBits(group.y & 0xffu & ((1u << place) - 1u));
    let of_top = has_objects && (*walk).floor == NO_FLOOR;
    let opened = open(index, of_top, (*walk).ray, (*found).limit);
    if has_objects && opened.object != NO_OBJECT {
        *walk = enter_object(ray, opened.object, (*stack).height);
        return true;
    }
    var left = opened.triangles.y;
    while left != 0u {
        let offset = firstTrailingBit(left);
        left &= left - 1u;
        if take(walk, opened.triangles.x + offset, flags, ends, found) {
            return false;
        }
    }
    (*walk).group = opened.children;
    if (opened.children.y & WAITING) != 0u {
        return true;
    }
    if has_objects && (*stack).height == (*walk).floor {
        (*walk).ray = top_ray(ray);
        (*walk).floor = NO_FLOOR;
    }
    if (*stack).height == 0u {
        return false;
    }
    (*walk).group = pop(stack);
    return true;
}
