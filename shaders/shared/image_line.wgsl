// A view ray in the image of a sample: a straight line that meets texel borders at depths with a closed form.

import package::shared::camera::{cube_face_of, in_cube_face, in_pinhole, texel_of_cube_face};
import package::shared::fetch::{ViewSample, has_face, inverse_range, omni, pinhole_of};

// The part of a view ray inside one pinhole image: a perspective sample, or one face of a cube.
struct ImageLine {
    // Homogeneous texel coordinates at depth t of the ray: first + along * t.
    first: vec3f,
    along: vec3f,
    // Sign of the change of each coordinate with depth; constant along a line.
    sense: vec2f,
    // Depths between which the ray is inside the image. begin > end if it never is.
    begin: f32,
    end: f32,
}

// Relative step ahead of a depth, about a hundred roundings.
const AHEAD: f32 = 1e-5;

// The part of a range of depths in which a + b t >= 0.
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

// The line of the ray in direction d between two depths in a sample. In a cube it is the line in the face that the ray is
// in just after the first depth; where it ends, call this again.
fn line_in_image(s: ViewSample, d: vec3f, near: f32, far: f32) -> ImageLine {
    let size = vec2f(textureDimensions(inverse_range));
    var span = vec2f(near, far);
    if omni {
        let face = cube_face_of(s.eye_from_center + d * (near * (1.0 + AHEAD)));
        let a = in_cube_face(face, s.eye_from_center);
        let b = in_cube_face(face, d);
        // A face contains the directions whose component along its axis is greatest.
        span = where_positive(span, a.z + a.x, b.z + b.x);
        span = where_positive(span, a.z - a.x, b.z - b.x);
        span = where_positive(span, a.z + a.y, b.z + b.y);
        span = where_positive(span, a.z - a.y, b.z - b.y);
        // Some face always contains the ray, so rounding does not stop it.
        span = vec2f(near, min(max(span.y, near * (1.0 + AHEAD)), far));
        // A face that the plan does not use is not looked at: the sample may look again where the ray leaves it.
        span = select(vec2f(span.y, far), span, has_face(s, face));
        return image_line(texel_of_cube_face(0.5 * size.y, face, a), texel_of_cube_face(0.5 * size.y, face, b), span);
    }
    let scale = vec3f(size, 1.0);
    let a = in_pinhole(pinhole_of(s), s.eye_from_center) * scale;
    let b = in_pinhole(pinhole_of(s), d) * scale;
    // A point inside all four sides is also in front of the camera.
    span = where_positive(span, a.x, b.x);
    span = where_positive(span, size.x * a.z - a.x, size.x * b.z - b.x);
    span = where_positive(span, a.y, b.y);
    span = where_positive(span, size.y * a.z - a.y, size.y * b.z - b.y);
    return image_line(a, b, span);
}

// Position of the line at a depth, texels.
fn texel_at(line: ImageLine, t: f32) -> vec2f {
    let h = line.first + line.along * t;
    return h.xy / max(h.z, 1e-30);
}

// Depth beyond t at which the line leaves its square cell of `side` texels; at most the line's end.
fn leaves_cell(line: ImageLine, cell: vec2f, side: f32, t: f32) -> f32 {
    let border = (cell + max(line.sense, vec2f(0.0))) * side;
    let slope = line.along.xy - border * line.along.z;
    let at = (border * line.first.z - line.first.xy) / select(slope, vec2f(1e-30), abs(slope) < vec2f(1e-30));
    // A border that the line only approaches has a crossing behind the eye, if any.
    let met = (line.sense != vec2f(0.0)) & (at > vec2f(t));
    let first = select(vec2f(line.end), at, met);
    return min(min(first.x, first.y), line.end);
}
