//! The paper's own figures for Sponza (tables 1 and 2), and for shadows (table 3, breakfast scene), on an NVIDIA GTX 1080 Ti at 1920×1080.

/// Points, shades and milliseconds of a frame; `None` where the paper has none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Published {
    pub(super) points: Option<u64>,
    pub(super) shades: Option<u64>,
    pub(super) ms: Option<f64>,
}

/// A row of the paper: number of reflectors; points, shades and milliseconds of EPR; points and milliseconds of iVIR; shades
/// and milliseconds of multi-view rendering.
type Row = (u32, [u64; 2], f64, u64, f64, u64, f64);

const SPONZA: [Row; 4] = [
    (1, [603_000, 44_000], 2.43, 2_790_000, 3.93, 1_510_000, 4.51),
    (10, [1_280_000, 146_000], 7.31, 5_730_000, 18.06, 15_240_000, 43.22),
    (20, [1_470_000, 335_000], 14.62, 6_390_000, 50.25, 30_600_000, 90.27),
    (50, [1_750_000, 812_000], 45.46, 7_690_000, 331.39, 76_570_000, 232.07),
];

/// Bytes of the maps of one reflector, by points and by multi-view rendering, and of a point (section 4.2.2).
const MAP_BYTES: [u64; 2] = [12_600_000, 25_200_000];
const POINT_BYTES: u64 = 80;

/// Bytes of maps and of stored points in the paper, for a number of reflectors and of points.
pub(super) fn memory(method: Method, reflectors: u32, points: Option<u64>) -> [Option<u64>; 2] {
    let points = points.map(|points| points * POINT_BYTES);
    match method {
        Method::Epr => [Some(MAP_BYTES[0] * u64::from(reflectors)), points],
        Method::Ivir => [None, points],
        Method::Mvr => [Some(MAP_BYTES[1] * u64::from(reflectors)), None],
    }
}

/// The paper's name of a way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Method {
    Epr,
    Ivir,
    Mvr,
}

/// What the paper found for a scene and a number of reflectors.
pub(super) fn published(scene: &str, reflectors: u32, method: Method) -> Published {
    let is_sponza = scene.to_ascii_lowercase().contains("sponza");
    let Some(row) = SPONZA.iter().find(|row| is_sponza && row.0 == reflectors) else {
        return Published::default();
    };
    let &(_, [points, shades], ms, ivir_points, ivir_ms, mvr_shades, mvr_ms) = row;
    match method {
        Method::Epr => Published { points: Some(points), shades: Some(shades), ms: Some(ms) },
        Method::Ivir => Published { points: Some(ivir_points), shades: None, ms: Some(ivir_ms) },
        Method::Mvr => Published { points: None, shades: Some(mvr_shades), ms: Some(mvr_ms) },
    }
}

/// Numbers of light points; points and milliseconds of EPR and of iVIR; milliseconds of multi-view rendering (table 3).
const SHADOWS: [(u32, u64, f64, u64, f64, f64); 4] = [
    (1, 8_590_000, 3.86, 10_940_000, 4.03, 2.97),
    (5, 8_910_000, 7.11, 11_430_000, 5.86, 7.22),
    (10, 9_040_000, 13.39, 11_690_000, 7.98, 15.95),
    (20, 9_120_000, 28.54, 11_740_000, 30.74, 31.80),
];

/// What the paper found for the shadows of a light of so many points, by the name of a way.
pub(super) fn shadows(light_samples: u32, way: &str) -> Published {
    let Some(row) = SHADOWS.iter().find(|row| row.0 == light_samples) else { return Published::default() };
    match way {
        "points" => Published { points: Some(row.1), shades: None, ms: Some(row.2) },
        "iVIR" => Published { points: Some(row.3), shades: None, ms: Some(row.4) },
        "MVR" => Published { points: None, shades: None, ms: Some(row.5) },
        _ => Published::default(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_paper_has_figures_for_its_own_scene_and_numbers_alone() {
        assert_eq!(published("scenes/Sponza.glb", 50, Method::Epr).points, Some(1_750_000));
        assert_eq!(published("sponza.glb", 50, Method::Mvr).ms, Some(232.07));
        assert_eq!(published("sponza.glb", 7, Method::Epr), Published::default());
        assert_eq!(shadows(20, "points").ms, Some(28.54));
        assert_eq!(shadows(3, "points"), Published::default());
        assert_eq!(memory(Method::Mvr, 20, None), [Some(504_000_000), None]);
        assert_eq!(memory(Method::Epr, 20, Some(1_000_000)), [Some(252_000_000), Some(80_000_000)]);
        assert_eq!(published("rooms", 50, Method::Epr), Published::default());
    }
}
