// Where a view ray runs in the image of a sample: along a straight line, which meets texel borders at depths that have a
// closed form.

import package::shared::camera::{cube_face_of, in_cube_face, in_pinhole, texel_of_cube_face};
import package::shared::fetch::{ViewSample, inverse_range, omni, pinhole_of};

// The part of a view ray that one pinhole image sees: a perspective sample, or one face of a cube.
struct ImageLine {
    // Texel coordinates times w, and w, at depth t along the ray: first + along * t.
    first: vec3f,
    along: vec3f,
    // Which way each coordinate goes with depth: 1, -1, or 0 where it stays. A line does not turn.
    sense: vec2f,
    // Depths between which the image sees the ray; it does not where they are not in order.
    begin: f32,
    end: f32,
}

// Share of a depth, by which a ray is looked ahead of it: about a hundred roundings.
const AHEAD: f32 = 1e-5;

// The part of the range in which a + b t is not negative.
fn where_positive(range: vec2f, a: f32, b: f32) -> vec2f {
    let parallel = abs(b) < 1e-30;
    let root = -a / select(b, 1.0, parallel);
    let begin = select(range.x, max(range.x, root), !parallel && b > 0.0);
    let end = select(range.y, min(range.y, root), !parallel && b < 0.0);
    return vec2f(begin, select(end, -1.0, parallel && a < 0.0));
}

fn image_line(first: vec3f, along: vec3f, span: vec2f) -> ImageLine {
    return ImageLine(first, along, sign(along.xy * first.z - first.xy * along.z), span.x, span.y);
}

// The line of the ray in direction d between two depths, in a sample. In a cube it is that in the face which the ray is
// about to be in at the first of them; where it ends, one asks again.
fn line_in_image(s: ViewSample, d: vec3f, near: f32, far: f32) -> ImageLine {
    let size = vec2f(textureDimensions(inverse_range));
    var span = vec2f(near, far);
    if omni {
        let face = cube_face_of(s.eye_from_center + d * (near * (1.0 + AHEAD)));
        let a = in_cube_face(face, s.eye_from_center);
        let b = in_cube_face(face, d);
        // A face has the directions of which no other component is greater.
        span = where_positive(span, a.z + a.x, b.z + b.x);
        span = where_positive(span, a.z - a.x, b.z - b.x);
        span = where_positive(span, a.z + a.y, b.z + b.y);
        span = where_positive(span, a.z - a.y, b.z - b.y);
        // Wherever the ray is, some face sees it; however it was rounded, it goes on.
        span = vec2f(near, min(max(span.y, near * (1.0 + AHEAD)), far));
        return image_line(texel_of_cube_face(0.5 * size.y, face, a), texel_of_cube_face(0.5 * size.y, face, b), span);
    }
    let scale = vec3f(size, 1.0);
    let a = in_pinhole(pinhole_of(s), s.eye_from_center) * scale;
    let b = in_pinhole(pinhole_of(s), d) * scale;
    // Inside all four sides a point is also before the camera.
    span = where_positive(span, a.x, b.x);
    span = where_positive(span, size.x * a.z - a.x, size.x * b.z - b.x);
    span = where_positive(span, a.y, b.y);
    span = where_positive(span, size.y * a.z - a.y, size.y * b.z - b.y);
    return image_line(a, b, span);
}

// Where the line is at a depth that its image sees, in texels.
fn texel_at(line: ImageLine, t: f32) -> vec2f {
    let h = line.first + line.along * t;
    return h.xy / max(h.z, 1e-30);
}

// The depth at which the line leaves the square cell of `side` texels that it is in, beyond t; at most its end.
fn leaves_cell(line: ImageLine, cell: vec2f, side: f32, t: f32) -> f32 {
    let border = (cell + max(line.sense, vec2f(0.0))) * side;
    let slope = line.along.xy - border * line.along.z;
    let at = (border * line.first.z - line.first.xy) / select(slope, vec2f(1e-30), abs(slope) < vec2f(1e-30));
    // A border that a line approaches without ever reaching it is met behind the eye, if anywhere.
    let met = (line.sense != vec2f(0.0)) & (at > vec2f(t));
    let first = select(vec2f(line.end), at, met);
    return min(min(first.x, first.y), line.end);
}
