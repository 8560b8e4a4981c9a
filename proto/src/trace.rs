//! A view's trace across processes: who asked for what is done here, in the W3C form, in the metadata of its request.
//!
//! Libraries only open spans; whether and where they are exported is the binary's affair. While nobody exports them
//! spans of [`TARGET`] are not enabled, and all of this costs a look at a flag.

use std::borrow::Cow;
use std::time::{Duration, SystemTime};

use opentelemetry::propagation::{Extractor, Injector};
use opentelemetry::trace::{Span as _, SpanBuilder, TraceContextExt, Tracer};
use opentelemetry::{KeyValue, global};
use tonic::Request;
use tonic::metadata::{Ascii, MetadataKey, MetadataMap};
use tracing::Span;
use tracing_opentelemetry::OpenTelemetrySpanExt;

/// The target of all spans of a view's way: what an exporter takes, and a log leaves out.
pub const TARGET: &str = "argus::trace";

/// The field of the metadata that names a span.
const TRACEPARENT: &str = "traceparent";

/// A request that says which span it is made in.
pub fn within<T>(span: &Span, message: T) -> Request<T> {
    let mut request = Request::new(message);
    if !span.is_disabled() {
        let context = span.context();
        let mut metadata = Metadata(request.metadata_mut());
        global::get_text_map_propagator(|propagator| propagator.inject_context(&context, &mut metadata));
    }
    request
}

/// `span` as a message can name it that is no request of its own; empty while nobody traces.
pub fn traceparent(span: &Span) -> String {
    let request = within(span, ());
    let value = request.metadata().get(TRACEPARENT).and_then(|value| value.to_str().ok());
    value.unwrap_or_default().to_owned()
}

/// [`continued`], of the span that [`traceparent`] named. Whatever else stands there is passed over.
pub fn continued_from(span: &Span, traceparent: &str) {
    let mut metadata = MetadataMap::new();
    if let Ok(value) = traceparent.parse() {
        metadata.insert(TRACEPARENT, value);
        continued(span, &metadata);
    }
}

/// Makes `span` a child of the span that a request was made in, if it says so. Whatever else the request's metadata
/// claims is passed over.
pub fn continued(span: &Span, metadata: &MetadataMap) {
    if span.is_disabled() {
        return;
    }
    let mut metadata = metadata.clone();
    let metadata = Metadata(&mut metadata);
    let context = global::get_text_map_propagator(|propagator| propagator.extract(&metadata));
    if context.span().span_context().is_valid() {
        // It fails only for a span that has begun to be exported, which a new one has not.
        let _ = span.set_parent(context);
    }
}

/// Puts stages that were measured as durations, in milliseconds, one after the other, into `span` as its children, the
/// last one ending now.
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
