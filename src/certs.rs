//! `argus certs`: an authority of one's own, for development and for clusters without another one.

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

/// Where every machine finds itself.
const LOCAL: [&str; 3] = ["localhost", "127.0.0.1", "::1"];

/// Makes what a cluster with TLS needs: an authority, certificates of a server, of workers and of clients, and tokens.
///
/// Whoever has ca.key can join the cluster: keep it away from the machines that serve. Nothing is overwritten. The
/// cluster's processes know each other by the name cluster.argus.internal in their certificates, and clients know by it a
/// worker that the server sends them to; the server itself they know by its host's name.
#[derive(clap::Args)]
#[command(after_help = "\
Example: a cluster on this machine, by TLS
  argus certs certs
  argus serve --config certs/argus.toml --listen 0.0.0.0:7400
  argus view --config certs/argus.toml --server https://localhost:7400 --eye 60,40,60 --target 0,5,0 --out view.png
  argus certs certs --host render.example.org --days 30")]
pub(crate) struct Args {
    /// Folder to write to; made if it is not there
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// A name or address by which clients reach the server, beside localhost; may be given more than once
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
            return Err(bad_arguments(format!("--host {host}: a name or an address is wanted")));
        }
    }
    let files = made(args)?;
    make_folder(&args.folder)?;
    if let Some(there) = files.iter().find(|file| args.folder.join(file.name).exists()) {
        return Err(bad_arguments(format!(
            "{} is there already: choose another folder, or remove it if nothing needs it any more",
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
    println!("  argus.toml               settings of all that follows, for --config");
    println!("  ca.pem, ca.key           the authority; who has its key can join, so keep that elsewhere");
    println!("  server.pem, server.key   of the coordinator, for {}", hosts(args).join(", "));
    println!("  worker.pem, worker.key   of every worker");
    println!("  client.pem, client.key   of a client, where require_client_certificates is set");
    println!("  tokens                   what the coordinator knows clients by");
    println!("  view.token, admin.token  what clients show");
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

/// Everything, made anew.
fn made(args: &Args) -> anyhow::Result<Vec<File>> {
    use ExtendedKeyUsagePurpose::{ClientAuth, ServerAuth};
    let secret = |name, text| File { name, text, secret: true };
    let open = |name, text| File { name, text, secret: false };

    let mut params = named("Argus cluster authority", &[], args.days)?;
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    let authority = CertifiedIssuer::self_signed(params, KeyPair::generate()?)?;
    let mut files = vec![open("ca.pem", authority.pem()), secret("ca.key", authority.key().serialize_pem())];

    // Members serve and connect; a client connects alone, and lacks the name that members have. Clients know the
    // coordinator by its hosts' names, which workers therefore lack, so that none of them can pass for it; probes on a
    // worker's own machine find it as localhost.
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

    let (view, admin) = (token()?, token()?);
    files.push(secret("tokens", format!("# role name token\nview viewer {view}\nadmin operator {admin}\n")));
    files.push(secret("view.token", format!("{view}\n")));
    files.push(secret("admin.token", format!("{admin}\n")));
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
    // An hour ago, since the clocks of machines differ.
    params.not_before = (SystemTime::now() - Duration::from_secs(3600)).into();
    params.not_after = (SystemTime::now() + Duration::from_secs(86_400) * days).into();
    Ok(params)
}

/// 256 bits.
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

/// Writes a file that was not there; a secret is never readable by others, not even for a moment.
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
