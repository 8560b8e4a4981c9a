//! Distributed traces of views: W3C trace context in the metadata of requests.
//!
//! Libraries only open spans; the binary decides whether and where they are exported. Without an exporter, spans of
//! [`TARGET`] are disabled and cost a flag check.

use std::borrow::Cow;
use std::time::{Duration, SystemTime};

use opentelemetry::propagation::{Extractor, Injector};
use opentelemetry::trace::{Span as _, SpanBuilder, TraceContextExt, Tracer};
use opentelemetry::{KeyValue, global};
use tonic::Request;
use tonic::metadata::{Ascii, MetadataKey, MetadataMap};
use tracing::Span;
use tracing_opentelemetry::OpenTelemetrySpanExt;

/// The target of all spans of a view, which exporters select and logs omit.
pub const TARGET: &str = "argus::trace";

/// The metadata field with the parent span.
const TRACEPARENT: &str = "traceparent";

/// Makes a request with the trace context of `span`.
pub fn within<T>(span: &Span, message: T) -> Request<T> {
    let mut request = Request::new(message);
    if !span.is_disabled() {
        let context = span.context();
        let mut metadata = Metadata(request.metadata_mut());
        global::get_text_map_propagator(|propagator| propagator.inject_context(&context, &mut metadata));
    }
    request
}

/// The trace context of `span`, for a field of a message; empty without tracing.
pub fn traceparent(span: &Span) -> String {
    let request = within(span, ());
    let value = request.metadata().get(TRACEPARENT).and_then(|value| value.to_str().ok());
    value.unwrap_or_default().to_owned()
}

/// Makes `span` a child of the span in a message's trace context. Other contents are ignored.
pub fn continued_from(span: &Span, traceparent: &str) {
    let mut metadata = MetadataMap::new();
    if let Ok(value) = traceparent.parse() {
        metadata.insert(TRACEPARENT, value);
        continued(span, &metadata);
    }
}

/// Makes `span` a child of the span in a request's metadata, if there is one. Other metadata are ignored.
pub fn continued(span: &Span, metadata: &MetadataMap) {
    if span.is_disabled() {
        return;
    }
    let mut metadata = metadata.clone();
    let metadata = Metadata(&mut metadata);
    let context = global::get_text_map_propagator(|propagator| propagator.extract(&metadata));
    if context.span().span_context().is_valid() {
        // It fails only for a span that is already being exported, which a new one is not.
        let _ = span.set_parent(context);
    }
}

/// Adds stages with measured durations, milliseconds, to `span` as consecutive children, the last one ending now.
pub fn stages<'a>(span: &Span, stages: impl IntoIterator<Item = (&'a str, f64)>) {
    let context = span.context();
    if span.is_disabled() || !context.span().span_context().is_sampled() {
        return;
    }
    let stages: Vec<(&str, Duration)> = stages
        .into_iter()
        .map(|(name, ms)| (name, Duration::try_from_secs_f64(ms * 1e-3).unwrap_or_default()))
        .collect();
    let total = stages.iter().map(|(_, took)| *took).sum();
    let mut at = SystemTime::now().checked_sub(total).unwrap_or(SystemTime::UNIX_EPOCH);
    let tracer = global::tracer("argus");
    for (name, took) in stages {
        let builder = SpanBuilder::from_name(Cow::Owned(name.to_owned()))
            .with_start_time(at)
            .with_attributes([KeyValue::new("argus.measured", true)]);
        let mut stage = tracer.build_with_context(builder, &context);
        at += took;
        stage.end_with_timestamp(at);
    }
}

/// Metadata as a carrier of text.
struct Metadata<'m>(&'m mut MetadataMap);

impl Injector for Metadata<'_> {
    fn set(&mut self, key: &str, value: String) {
        let key = MetadataKey::<Ascii>::from_bytes(key.as_bytes());
        if let (Ok(key), Ok(value)) = (key, value.parse()) {
            self.0.insert(key, value);
        }
    }
}

impl Extractor for Metadata<'_> {
    fn get(&self, key: &str) -> Option<&str> {
        self.0.get(key)?.to_str().ok()
    }

    fn keys(&self) -> Vec<&str> {
        // Only named fields are looked up.
        Vec::new()
    }
}
