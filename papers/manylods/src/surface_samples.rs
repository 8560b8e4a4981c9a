//! Points on a scene's surfaces, uniform by area, that move with their triangles.

use argus_megaviews::hierarchy::Triangle;

/// A point of a triangle: 16 bytes in the layout of the programs.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct SurfaceSample {
    /// Index of the triangle.
    pub triangle: u32,
    /// Barycentric coordinate of its second corner.
    pub s: f32,
    /// Barycentric coordinate of its third corner.
    pub t: f32,
    /// Area that the point represents, as a share of its triangle's. Above 1 if it represents other triangles too.
    pub share: f32,
}

/// `count` points, distributed by area, and within a triangle by an additive recurrence with the generalised golden ratio
/// (Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018). Empty if no triangle has an area.
/// Deterministic.
pub fn surface_samples(triangles: &[Triangle], count: u32) -> Vec<SurfaceSample> {
    let area = |triangle: &Triangle| {
        let [a, b, c] = triangle.corners;
        if triangle.is_surface() { 0.5 * (b - a).cross(c - a).length() } else { 0.0 }
    };
    let areas: Vec<f64> = triangles.iter().map(area).collect();
    let whole: f64 = areas.iter().sum();
    if !(whole > 0.0 && whole.is_finite()) {
        return Vec::new();
    }
    let each = whole / f64::from(count);
    let mut samples = Vec::with_capacity(count as usize);
    let mut up_to = 0.0;
    for (index, (&own, triangle)) in areas.iter().zip(0u32..).enumerate() {
        up_to += own;
        let last = index + 1 == areas.len();
        let first = samples.len();
        // The nth point stands for the area from n to n + 1 of those shares; it lies where the middle of that does.
        while samples.len() < count as usize && ((samples.len() as f64 + 0.5) * each < up_to || last) {
            let nth = (samples.len() - first) as f64;
            let [s, t] = within(triangle, nth);
            samples.push(SurfaceSample { triangle, s, t, share: (each / own) as f32 });
        }
    }
    // Rounding may leave the last points to triangles without area at the end of the list.
    let solid = samples.iter().rposition(|sample| sample.share.is_finite()).unwrap_or(0);
    let end = samples[solid];
    samples[solid..].iter_mut().for_each(|sample| *sample = end);
    samples
}

/// Barycentric coordinates of the nth point of a triangle.
fn within(triangle: u32, nth: f64) -> [f32; 2] {
    // 1/g and 1/g² for g³ = g + 1; each triangle begins elsewhere.
    let begin = f64::from(triangle) * 0.618_033_988_749_894_9;
    let u = (0.5 + begin + nth * 0.754_877_666_246_693).fract();
    let v = (0.5 + begin * 0.5 + nth * 0.569_840_290_998_053_3).fract();
    // The half of the unit square beyond the diagonal is folded back.
    let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
    [u as f32, v as f32]
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};

    use super::*;

    fn triangle(size: f64, at: f64) -> Triangle {
        let at = DVec3::X * at;
        Triangle { corners: [at, at + DVec3::X * size, at + DVec3::Y * size], color: Vec3::ONE }
    }

    #[test]
    fn triangles_have_as_many_samples_as_their_area_earns() {
        let triangles = [triangle(1.0, 0.0), triangle(0.0, 1.0), triangle(3.0, 2.0), triangle(0.001, 5.0)];
        let samples = surface_samples(&triangles, 1000);
        assert_eq!(samples.len(), 1000);
        let of = |n: u32| samples.iter().filter(|s| s.triangle == n).count();
        assert!(of(0).abs_diff(100) <= 1 && of(1) == 0 && of(2).abs_diff(900) <= 1, "{} {}", of(0), of(2));
        let inside = |s: &SurfaceSample| s.s >= 0.0 && s.t >= 0.0 && s.s + s.t <= 1.0 && s.share > 0.0;
        assert!(samples.iter().all(inside));
    }

    #[test]
    fn samples_of_one_triangle_leave_no_large_part_of_it_empty() {
        let samples = surface_samples(&[triangle(1.0, 0.0)], 1024);
        // Cells of a sixteenth that lie wholly in the triangle have about 8 points each.
        for x in 0..16 {
            for y in 0..15 - x {
                let holds = |s: &&SurfaceSample| (s.s * 16.0) as u32 == x && (s.t * 16.0) as u32 == y;
                let count = samples.iter().filter(holds).count();
                assert!((4..=13).contains(&count), "{count} points in cell {x}, {y}");
            }
        }
    }

    #[test]
    fn what_has_no_area_or_is_nowhere_has_no_samples() {
        let nowhere = Triangle { corners: [DVec3::NAN; 3], color: Vec3::ONE };
        assert!(surface_samples(&[], 8).is_empty());
        assert!(surface_samples(&[triangle(0.0, 1.0), nowhere], 8).is_empty());
        let some = surface_samples(&[nowhere, triangle(1.0, 0.0), triangle(0.0, 1.0)], 8);
        assert!(some.len() == 8 && some.iter().all(|s| s.triangle == 1 && s.share.is_finite()));
    }
}
