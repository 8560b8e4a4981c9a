//! The log of this process, on standard error, and the traces of views, to a collector.

use std::io::IsTerminal;

use anyhow::Context;
use argus_proto::trace::TARGET;
use clap::ValueEnum;
use opentelemetry::trace::TracerProvider;
use opentelemetry::{KeyValue, global};
use opentelemetry_otlp::{SpanExporter, WithTonicConfig};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::propagation::TraceContextPropagator;
use opentelemetry_sdk::trace::SdkTracerProvider;
use tonic::transport::{Certificate, ClientTlsConfig};
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::{FormatTime, SystemTime};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer, Registry};

/// Format of the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum LogFormat {
    /// Text for people.
    Text,
    /// One JSON object per line, for log collectors.
    Json,
}

/// Environment variables with the trace collector's address, as OpenTelemetry defines them.
const ENDPOINTS: [&str; 2] = ["OTEL_EXPORTER_OTLP_TRACES_ENDPOINT", "OTEL_EXPORTER_OTLP_ENDPOINT"];

/// Environment variables with the certificate authority of the trace collector, for `https://`.
const AUTHORITIES: [&str; 2] = ["OTEL_EXPORTER_OTLP_TRACES_CERTIFICATE", "OTEL_EXPORTER_OTLP_CERTIFICATE"];

/// The part of commands that are no process of a service: clients, studies and tools.
pub(crate) const CLIENT: &str = "client";

/// Sends the remaining traces when it is finished.
pub(crate) struct Telemetry(Option<SdkTracerProvider>);

/// Starts logging at the level of `verbosity` (the number of `-v`); `ARGUS_LOG` overrides it. A [`CLIENT`] logs
/// warnings alone. Exports traces if the environment names a collector. Must be called within the runtime that exports them.
///
/// # Errors
/// The collector's address is invalid.
pub(crate) fn start(verbosity: u8, format: LogFormat, part: &str) -> anyhow::Result<Telemetry> {
    let default = match verbosity {
        0 if part == CLIENT => "warn,wgpu_hal=error",
        0 => "warn,argus=info,wgpu_hal=error",
        1 => "info,argus_cluster=debug,wgpu_core=warn,wgpu_hal=warn,naga=warn",
        _ => "debug",
    };
    let filter = EnvFilter::try_from_env("ARGUS_LOG").unwrap_or_else(|_| EnvFilter::new(default));
    // Spans of single frames go to traces, not to the log.
    let filter = match format!("{TARGET}=off").parse() {
        Ok(directive) => filter.add_directive(directive),
        Err(_) => filter,
    };
    let lines = tracing_subscriber::fmt::layer().with_writer(std::io::stderr);
    let lines = match format {
        LogFormat::Text => {
            let who = Stamp(format!("{part}[{}]", std::process::id()));
            lines.with_ansi(std::io::stderr().is_terminal()).compact().with_timer(who).boxed()
        }
        LogFormat::Json => lines.json().flatten_event(true).with_current_span(false).boxed(),
    };
    let provider = match ENDPOINTS.iter().any(|name| std::env::var_os(name).is_some()) {
        true => Some(provider(part)?),
        false => None,
    };
    let traces = provider.as_ref().map(|provider| {
        let only = Targets::new().with_target(TARGET, LevelFilter::DEBUG);
        tracing_opentelemetry::layer().with_tracer(provider.tracer("argus")).with_filter(only)
    });
    Registry::default().with(lines.with_filter(filter)).with(traces).init();
    Ok(Telemetry(provider))
}

/// The time and the process of a log line: `argus serve` and its workers write to the same terminal.
struct Stamp(String);

impl FormatTime for Stamp {
    fn format_time(&self, writer: &mut Writer<'_>) -> std::fmt::Result {
        SystemTime.format_time(writer)?;
        write!(writer, " {}", self.0)
    }
}

/// Sends spans in batches to the collector that the environment names.
fn provider(part: &str) -> anyhow::Result<SdkTracerProvider> {
    let mut exporter = SpanExporter::builder().with_tonic();
    let endpoint = ENDPOINTS.iter().find_map(|name| std::env::var(name).ok()).unwrap_or_default();
    if endpoint.starts_with("https:") {
        exporter = exporter.with_tls_config(collector_tls()?);
    }
    let exporter = exporter
        .build()
        .with_context(|| format!("traces cannot be exported to the collector in {}", ENDPOINTS[1]))?;
    let named = std::env::var_os("OTEL_SERVICE_NAME").is_some();
    let mut resource = Resource::builder();
    if !named {
        resource = resource.with_service_name(format!("argus-{part}"));
    }
    let resource =
        resource.with_attribute(KeyValue::new("process.pid", i64::from(std::process::id()))).build();
    let provider = SdkTracerProvider::builder().with_batch_exporter(exporter).with_resource(resource).build();
    global::set_text_map_propagator(TraceContextPropagator::new());
    global::set_tracer_provider(provider.clone());
    Ok(provider)
}

/// The certificate authorities for the collector: the one that the environment names, or those of this system.
fn collector_tls() -> anyhow::Result<ClientTlsConfig> {
    let named = AUTHORITIES.iter().find_map(|name| Some((name, std::env::var_os(name)?)));
    let Some((name, path)) = named else { return Ok(ClientTlsConfig::new().with_native_roots()) };
    let pem = std::fs::read(&path).with_context(|| format!("{name}: cannot read {}", path.display()))?;
    Ok(ClientTlsConfig::new().ca_certificate(Certificate::from_pem(pem)))
}

impl Telemetry {
    /// Sends the remaining traces, for a few seconds at most. An unreachable collector does not keep the
    /// process from ending.
    pub(crate) fn finish(self) {
        if let Some(Err(error)) = self.0.map(|provider| provider.shutdown()) {
            tracing::debug!(%error, "not all traces were sent");
        }
    }
}
