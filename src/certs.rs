//! `argus certs`: a certificate authority for development and for clusters without one.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use anyhow::Context;
use argus_cluster::security::CLUSTER_NAME;
use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use rand::TryRngCore;
use rand::rngs::OsRng;
use rcgen::{
    BasicConstraints, CertificateParams, CertifiedIssuer, DnType, ExtendedKeyUsagePurpose, IsCa, KeyPair,
    KeyUsagePurpose,
};
use rustls_pki_types::ServerName;
use serde::Serialize;

use crate::exit::bad_arguments;
use crate::output;

/// Names of this machine for itself.
const LOCAL: [&str; 3] = ["localhost", "127.0.0.1", "::1"];

/// Creates the files of a cluster with TLS: an authority, certificates for the server, workers and clients, and tokens.
///
/// Everyone with ca.key can join the cluster: keep it away from the machines that serve. No file is overwritten.
/// Processes of the cluster recognise each other by the name cluster.argus.internal in their certificates, and
/// clients recognise a worker to which the server redirects them by it. Clients recognise the server by its host
/// name.
#[derive(clap::Args)]
#[command(after_help = "\
Example: a cluster on this machine, by TLS
  argus certs certs
  argus serve --config certs/argus.toml --listen 0.0.0.0:7400
  argus view --config certs/argus.toml --server https://localhost:7400 --out view.png
  argus certs certs --host render.example.org --days 30")]
pub(crate) struct Args {
    /// Folder to write to; created if it does not exist
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// A further name or address by which clients reach the server; may be given more than once
    #[arg(long = "host", value_name = "NAME")]
    hosts: Vec<String>,
    /// Days until the certificates expire
    #[arg(long, value_name = "DAYS", default_value = "365", value_parser = clap::value_parser!(u32).range(1..=3650))]
    days: u32,
    /// Print one JSON object: folder, files
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report<'a> {
    folder: &'a Path,
    files: Vec<&'a str>,
}

/// A file to write.
struct File {
    name: &'static str,
    text: String,
    secret: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    for host in &args.hosts {
        if ServerName::try_from(host.as_str()).is_err() {
            return Err(bad_arguments(format!("--host {host}: must be a host name or an address")));
        }
    }
    let files = made(args)?;
    make_folder(&args.folder)?;
    if let Some(there) = files.iter().find(|file| args.folder.join(file.name).exists()) {
        return Err(bad_arguments(format!(
            "{} is there already: choose another folder, or remove the file if it is no longer needed",
            args.folder.join(there.name).display()
        )));
    }
    for file in &files {
        write(&args.folder.join(file.name), file)?;
    }
    if args.json {
        let files = files.iter().map(|file| file.name).collect();
        return output::json(&Report { folder: &args.folder, files });
    }
    let folder = args.folder.display();
    println!("written to {folder}, for {} days:", args.days);
    println!("  argus.toml               settings for all of the following, for --config");
    println!(
        "  ca.pem, ca.key           the authority; everyone with its key can join, so store it elsewhere"
    );
    println!("  server.pem, server.key   for the coordinator, as {}", hosts(args).join(", "));
    println!("  worker.pem, worker.key   for every worker");
    println!("  client.pem, client.key   for a client, if require_client_certificates is set");
    println!("  tokens                   the clients' tokens, for the coordinator");
    println!("  view.token               a client's token, for views");
    println!("  author.token             the same, and for moving nodes of the scene");
    println!("  admin.token              the same, and for status and metrics");
    println!("\nall on this machine:");
    println!("  argus serve --config {folder}/argus.toml");
    println!("  argus status --config {folder}/argus.toml");
    println!("over machines:");
    println!(
        "  host-a$ argus coordinator --scene S --listen 0.0.0.0:7400 --certificate {folder}/server.pem \
         --key {folder}/server.key --ca {folder}/ca.pem --tokens {folder}/tokens"
    );
    println!(
        "  host-b$ argus worker --coordinator https://host-a:7400 --listen 0.0.0.0:7401 --advertise \
         https://host-b:7401 --certificate {folder}/worker.pem --key {folder}/worker.key --ca {folder}/ca.pem"
    );
    println!(
        "  host-c$ argus view --server https://host-a:7400 --ca {folder}/ca.pem --token-file {folder}/view.token …"
    );
    Ok(())
}

fn hosts(args: &Args) -> Vec<&str> {
    LOCAL.into_iter().chain(args.hosts.iter().map(String::as_str)).collect()
}

/// Generates all files.
fn made(args: &Args) -> anyhow::Result<Vec<File>> {
    use ExtendedKeyUsagePurpose::{ClientAuth, ServerAuth};
    let secret = |name, text| File { name, text, secret: true };
    let open = |name, text| File { name, text, secret: false };

    let mut params = named("Argus cluster authority", &[], args.days)?;
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    let authority = CertifiedIssuer::self_signed(params, KeyPair::generate()?)?;
    let mut files = vec![open("ca.pem", authority.pem()), secret("ca.key", authority.key().serialize_pem())];

    // Members both serve and connect. A client only connects, and lacks the members' name. Clients recognise the
    // coordinator by its host names; workers lack these, so that no worker can impersonate it. A worker's certificate
    // includes localhost for probes on its own machine.
    let coordinator: Vec<&str> = std::iter::once(CLUSTER_NAME).chain(hosts(args)).collect();
    let worker: Vec<&str> = std::iter::once(CLUSTER_NAME).chain(LOCAL).collect();
    let kinds = [
        (["server.pem", "server.key"], "Argus coordinator", &coordinator[..], vec![ServerAuth, ClientAuth]),
        (["worker.pem", "worker.key"], "Argus worker", &worker[..], vec![ServerAuth, ClientAuth]),
        (["client.pem", "client.key"], "Argus client", &["client.argus.internal"][..], vec![ClientAuth]),
    ];
    for ([certificate, key], name, hosts, purposes) in kinds {
        let mut params = named(name, hosts, args.days)?;
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = purposes;
        params.use_authority_key_identifier_extension = true;
        let pair = KeyPair::generate()?;
        files.push(open(certificate, params.signed_by(&pair, &authority)?.pem()));
        files.push(secret(key, pair.serialize_pem()));
    }

    let mut tokens = "# role name token\n".to_owned();
    for (role, name, file) in [
        ("view", "viewer", "view.token"),
        ("author", "author", "author.token"),
        ("admin", "operator", "admin.token"),
    ] {
        let token = token()?;
        tokens.push_str(&format!("{role} {name} {token}\n"));
        files.push(secret(file, format!("{token}\n")));
    }
    files.push(secret("tokens", tokens));
    let settings = "\
# Made by `argus certs`: a service and its clients on one machine. Paths start from this folder.

[client]
server = \"https://localhost:7400\"
ca = \"ca.pem\"
# The operator's; view.token is enough for views, and too little for `argus status`.
token_file = \"admin.token\"

[security]
certificate = \"server.pem\"
key = \"server.key\"
ca = \"ca.pem\"
tokens = \"tokens\"
";
    files.push(open("argus.toml", settings.to_owned()));
    Ok(files)
}

fn named(name: &str, hosts: &[&str], days: u32) -> anyhow::Result<CertificateParams> {
    let hosts: Vec<String> = hosts.iter().map(|&host| host.to_owned()).collect();
    let mut params = CertificateParams::new(hosts)?;
    params.distinguished_name.push(DnType::CommonName, name);
    // One hour ago, since clocks differ.
    params.not_before = (SystemTime::now() - Duration::from_secs(3600)).into();
    params.not_after = (SystemTime::now() + Duration::from_secs(86_400) * days).into();
    Ok(params)
}

/// A random token of 256 bits.
fn token() -> anyhow::Result<String> {
    let mut bytes = [0; 32];
    OsRng.try_fill_bytes(&mut bytes).context("the operating system has no randomness")?;
    Ok(URL_SAFE_NO_PAD.encode(bytes))
}

fn make_folder(folder: &Path) -> anyhow::Result<()> {
    let mut builder = std::fs::DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(folder).with_context(|| format!("cannot make {}", folder.display()))
}

/// Writes a new file. A secret file is never readable by other users, not even for a moment.
fn write(path: &Path, file: &File) -> anyhow::Result<()> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, if file.secret { 0o600 } else { 0o644 });
    options
        .open(path)
        .and_then(|mut out| out.write_all(file.text.as_bytes()))
        .with_context(|| format!("cannot write {}", path.display()))
}
