//! Stages of several views and rounds.

use argus_scene::Stage;

use crate::median::median;

/// Mean of stages of several views, by name.
pub(super) fn mean_stages<'a>(views: impl ExactSizeIterator<Item = &'a [Stage]>) -> Vec<Stage> {
    let count = views.len() as f64;
    let mut sum: Vec<Stage> = Vec::new();
    for stage in views.flatten() {
        match sum.iter_mut().find(|known| known.name == stage.name) {
            Some(known) => known.ms += stage.ms / count,
            None => sum.push(Stage::new(stage.name.clone(), stage.ms / count)),
        }
    }
    sum
}

/// Medians of stages over rounds, by name.
pub(super) fn typical(rounds: &[(f64, Vec<Stage>)]) -> Vec<Stage> {
    let Some((_, last)) = rounds.last() else { return Vec::new() };
    let of = |name: &str| -> Vec<f64> { rounds.iter().map(|(_, stages)| ms_of(stages, name)).collect() };
    last.iter().map(|stage| Stage::new(stage.name.clone(), median(&of(&stage.name)))).collect()
}

/// Milliseconds of the stages of a name.
pub(super) fn ms_of(stages: &[Stage], name: &str) -> f64 {
    // From 0.0, because the sum of no floats is -0.0.
    stages.iter().filter(|stage| stage.name == name).fold(0.0, |sum, stage| sum + stage.ms)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_are_averaged_over_views_and_the_median_of_rounds() {
        let stage = |ms| vec![Stage::new("a", ms)];
        let views = [stage(1.0), stage(3.0), vec![Stage::new("b", 3.0)]];
        let mean = mean_stages(views.iter().map(Vec::as_slice));
        assert_eq!((ms_of(&mean, "a"), ms_of(&mean, "b")), (4.0 / 3.0, 1.0));
        let rounds = [(0.0, stage(9.0)), (0.0, Vec::new()), (0.0, stage(4.0))];
        assert_eq!(typical(&rounds), stage(4.0));
    }
}
