//! Where the rays of a pixel are.

use std::f64::consts::PI;

use glam::DVec2;

/// Offsets of `count` taps from a pixel's middle, in pixels: evenly in a disc of a pixel's area (Vogel, 1979). One tap is in
/// the middle. The paper takes 25.
pub fn taps(count: u32) -> Vec<DVec2> {
    if count <= 1 {
        return vec![DVec2::ZERO];
    }
    let turn = PI * (3.0 - 5f64.sqrt());
    let radius = PI.sqrt().recip();
    let tap = |k: u32| {
        let from_middle = radius * ((f64::from(k) + 0.5) / f64::from(count)).sqrt();
        DVec2::from_angle(turn * f64::from(k)) * from_middle
    };
    (0..count).map(tap).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn taps_lie_evenly_in_a_disc_of_a_pixels_area() {
        assert_eq!(taps(1), [DVec2::ZERO]);
        for count in [4, 25, 100] {
            let found = taps(count);
            assert_eq!(found.len(), count as usize);
            let mean = found.iter().sum::<DVec2>() / f64::from(count);
            assert!(mean.length() < 0.12, "{mean}");
            assert!(found.iter().all(|tap| PI * tap.length_squared() <= 1.0));
            // The mean square of the distance in a disc is half of the square of its radius.
            let square = found.iter().map(|tap| tap.length_squared()).sum::<f64>() / f64::from(count);
            assert!((square * 2.0 * PI - 1.0).abs() < 1e-9, "{square}");
        }
    }
}
