//! Metrics that are computed when they are scraped, from the process's state.

use std::fmt;

use prometheus_client::encoding::{
    DescriptorEncoder, EncodeLabel, EncodeLabelSet, LabelSetEncoder, MetricEncoder, NoLabelSet,
};
use prometheus_client::metrics::MetricType;

/// Writer of metrics.
pub(crate) struct Exposition<'a>(DescriptorEncoder<'a>);

/// Labels of one row: names and values.
type Labels<'l, const N: usize> = [(&'l str, &'l str); N];

/// A row of one of several scenes: the scene's name, other labels, and the value. Without a name the row has no label `scene`.
pub(crate) type SceneRow<'l, const N: usize> = (Option<&'l str>, Labels<'l, N>, f64);

/// Labels, in the library's form.
#[derive(Debug)]
struct LabelSet<'l, const N: usize>(Option<&'l str>, Labels<'l, N>);

impl<const N: usize> EncodeLabelSet for LabelSet<'_, N> {
    fn encode(&self, encoder: &mut LabelSetEncoder<'_>) -> fmt::Result {
        let scene = self.0.map(|scene| ("scene", scene));
        for label in scene.iter().chain(&self.1) {
            label.encode(encoder.encode_label())?;
        }
        Ok(())
    }
}

impl<'a> Exposition<'a> {
    pub(crate) fn new(encoder: DescriptorEncoder<'a>) -> Self {
        Self(encoder)
    }

    /// Writes a gauge: a number that goes up and down. Non-finite values are omitted.
    pub(crate) fn gauge(&mut self, name: &str, help: &str, value: f64) -> fmt::Result {
        self.gauges(name, help, [([], value)])
    }

    /// Writes a gauge for each set of labels.
    pub(crate) fn gauges<'l, const N: usize>(
        &mut self,
        name: &str,
        help: &str,
        rows: impl IntoIterator<Item = (Labels<'l, N>, f64)>,
    ) -> fmt::Result {
        self.gauges_of_scenes(name, help, rows.into_iter().map(|(labels, value)| (None, labels, value)))
    }

    /// Writes a gauge like [`Self::gauges`], with rows of several scenes.
    pub(crate) fn gauges_of_scenes<'l, const N: usize>(
        &mut self,
        name: &str,
        help: &str,
        rows: impl Iterator<Item = SceneRow<'l, N>>,
    ) -> fmt::Result {
        let rows = rows.filter(|(_, _, value)| value.is_finite());
        self.family(name, help, MetricType::Gauge, rows, |mut encoder, value| encoder.encode_gauge(&value))
    }

    /// Writes a counter: a number that only grows. `_total` is appended to its name.
    pub(crate) fn counter(&mut self, name: &str, help: &str, value: u64) -> fmt::Result {
        self.counters(name, help, [([], value as f64)])
    }

    /// Writes a counter for each set of labels.
    pub(crate) fn counters<'l, const N: usize>(
        &mut self,
        name: &str,
        help: &str,
        rows: impl IntoIterator<Item = (Labels<'l, N>, f64)>,
    ) -> fmt::Result {
        self.counters_of_scenes(name, help, rows.into_iter().map(|(labels, value)| (None, labels, value)))
    }

    /// Writes a counter like [`Self::counters`], with rows of several scenes.
    pub(crate) fn counters_of_scenes<'l, const N: usize>(
        &mut self,
        name: &str,
        help: &str,
        rows: impl Iterator<Item = SceneRow<'l, N>>,
    ) -> fmt::Result {
        self.family(name, help, MetricType::Counter, rows, |mut encoder, value| {
            encoder.encode_counter::<NoLabelSet, _, f64>(&value, None)
        })
    }

    fn family<'l, const N: usize>(
        &mut self,
        name: &str,
        help: &str,
        kind: MetricType,
        rows: impl Iterator<Item = SceneRow<'l, N>>,
        encode: impl Fn(MetricEncoder<'_>, f64) -> fmt::Result,
    ) -> fmt::Result {
        let mut encoder = self.0.encode_descriptor(name, help, None, kind)?;
        for (scene, labels, value) in rows {
            if N == 0 && scene.is_none() {
                // Without labels there is only one row.
                return encode(encoder, value);
            }
            encode(encoder.encode_family(&LabelSet(scene, labels))?, value)?;
        }
        Ok(())
    }
}
