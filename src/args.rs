//! Arguments that several subcommands share: servers, viewpoints, points and sizes; and, each in its file, how samples are
//! rendered, how a view is answered, and flags that are passed on.

mod camera;
mod lens;
mod passed_on;
mod plan;
mod pose;
mod samples;

use std::path::PathBuf;

use argus_client::{Client, ConnectOptions};
use glam::DVec3;

pub(crate) use self::camera::{Picture, Viewpoint, flags_of};
pub(crate) use self::lens::LensArgs;
pub use self::passed_on::PassedOn;
pub use self::plan::search;
pub(crate) use self::plan::{Plan, output, walk};
pub(crate) use self::pose::{Axes, placed, pose_of};
pub use self::samples::Rig;
pub(crate) use self::samples::{Rendering, Samples, effects, exposure, light};
use crate::credentials;
use crate::settings::{self, Flags, Sources};

/// The address and credentials of the service, for every client subcommand.
#[derive(clap::Args, Clone)]
pub(crate) struct Server {
    /// Address of the service [default: ARGUS_SERVER, else http://127.0.0.1:7400]
    #[arg(long, alias = "connect", value_name = "URL")]
    server: Option<String>,
    /// PEM file of the certificate authority that signed the service's certificate; needed for https://
    #[arg(long, value_name = "FILE")]
    ca: Option<PathBuf>,
    /// File with this client's access token
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// Name of the scene, of a service with several (`argus status` lists them) [default: its first one]
    #[arg(long, value_name = "NAME")]
    scene_name: Option<String>,
}

impl Server {
    /// Connects to the service that the settings name, over `connections` connections.
    pub(crate) async fn connect(&self, sources: &Sources, connections: usize) -> anyhow::Result<Client> {
        let (url, options) = self.options(sources)?;
        Ok(Client::connect_with(&url, &ConnectOptions { connections, ..options }).await?)
    }

    /// Returns the service's address and the options of a connection to it.
    pub(crate) fn options(&self, sources: &Sources) -> anyhow::Result<(String, ConnectOptions)> {
        let settings = self.settings(sources)?;
        let options = credentials::of_client(&settings)?;
        Ok((settings.server, options))
    }

    /// The client's settings, including these flags.
    pub(crate) fn settings(&self, sources: &Sources) -> anyhow::Result<settings::Client> {
        let flags = Flags::default()
            .with("client.server", "--server", self.server.as_ref())
            .with("client.ca", "--ca", settings::path(self.ca.as_ref()))
            .with("client.token_file", "--token-file", settings::path(self.token_file.as_ref()))
            .with("client.scene", "--scene-name", self.scene_name.as_ref());
        Ok(sources.load(flags)?.settings.client)
    }
}

/// Certificates of a process of the cluster.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Security (`argus certs` makes the files)")]
pub(crate) struct Security {
    /// PEM file of this process's certificate; with it, every connection from and to this process uses TLS
    #[arg(long, value_name = "FILE")]
    certificate: Option<PathBuf>,
    /// PEM file of the certificate's private key
    #[arg(long, value_name = "FILE")]
    key: Option<PathBuf>,
    /// PEM file of the certificate authority that signs the certificates of the cluster's processes
    #[arg(long, value_name = "FILE")]
    ca: Option<PathBuf>,
    /// Listen on addresses beyond this machine without TLS: everyone who can reach the port has full access
    #[arg(long)]
    insecure: bool,
}

impl Security {
    /// Adds these flags to those of a subcommand.
    pub(crate) fn with(&self, flags: Flags) -> Flags {
        flags
            .with("security.certificate", "--certificate", settings::path(self.certificate.as_ref()))
            .with("security.key", "--key", settings::path(self.key.as_ref()))
            .with("security.ca", "--ca", settings::path(self.ca.as_ref()))
            .with("security.insecure", "--insecure", self.insecure.then_some(true))
    }
}

/// The environment of a scene.
#[derive(clap::Args, Debug, Clone)]
pub struct Environment {
    /// Environment map in place of the scene's sky, and of the sun of a scene without lights: an image of all directions
    /// (equirectangular, twice as wide as high) in Radiance (.hdr) or OpenEXR (.exr) format. Up is +Y, the centre is +Z, +X is a
    /// quarter of the width from the left. Its up to eight strongest small regions become lights
    #[arg(long, value_name = "FILE")]
    environment: Option<String>,
}

impl Environment {
    /// The file, if one was given.
    pub(crate) fn file(&self) -> Option<&String> {
        self.environment.as_ref()
    }

    /// The specification of a scene in this environment.
    pub fn of(&self, scene: &str) -> String {
        match &self.environment {
            Some(file) => argus_scene::in_environment(scene, file),
            None => scene.to_owned(),
        }
    }
}

/// Parses `X,Y,Z`. Infinite and NaN numbers pass: the service names the invalid field.
pub fn point(text: &str) -> Result<DVec3, String> {
    let parts = text.split(',').map(|part| part.trim().parse::<f64>()).collect::<Result<Vec<_>, _>>();
    match parts.as_deref() {
        Ok(&[x, y, z]) => Ok(DVec3::new(x, y, z)),
        _ => Err("must be three numbers separated by commas, such as 3,2.5,-1".to_owned()),
    }
}

/// Parses `WIDTHxHEIGHT`. Zero passes: the service names the limits.
pub fn size(text: &str) -> Result<[u32; 2], String> {
    let sides = text.split_once(['x', 'X']).map(|(w, h)| (w.trim().parse(), h.trim().parse()));
    match sides {
        Some((Ok(width), Ok(height))) => Ok([width, height]),
        _ => Err("must be two whole numbers separated by x, such as 640x480".to_owned()),
    }
}

/// Parses a finite number above zero.
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number > 0.0 && number.is_finite() => Ok(number),
        _ => Err("must be a finite number above 0".to_owned()),
    }
}

/// Parses a number from 0 to 1.
pub(crate) fn share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if (0.0..=1.0).contains(&number) => Ok(number),
        _ => Err("must be a number from 0 to 1".to_owned()),
    }
}

/// Parses a finite number of at least zero.
pub(crate) fn zero_or_more(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number >= 0.0 && number.is_finite() => Ok(number),
        _ => Err("must be a finite number of at least 0".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_accept_signs_spaces_and_infinite_numbers() {
        assert_eq!(point("1,-2.5,1e6"), Ok(DVec3::new(1.0, -2.5, 1e6)));
        assert_eq!(point(" 1, 2 ,3 "), Ok(DVec3::new(1.0, 2.0, 3.0)));
        assert!(point("nan,0,inf").unwrap().x.is_nan());
        for wrong in ["", "1,2", "1,2,3,4", "1;2;3", "a,b,c"] {
            assert!(point(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn sizes_are_two_whole_numbers() {
        assert_eq!(size("640x480"), Ok([640, 480]));
        assert_eq!(size("0x0"), Ok([0, 0]));
        for wrong in ["", "640", "640x", "-1x5", "1.5x2", "640x480x3", "99999999999x1"] {
            assert!(size(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn cell_sizes_are_above_zero() {
        assert_eq!(positive("0.5"), Ok(0.5));
        for wrong in ["0", "-1", "nan", "inf", ""] {
            assert!(positive(wrong).is_err(), "{wrong}");
        }
        assert_eq!(zero_or_more("0"), Ok(0.0));
        for wrong in ["-1", "nan", "inf", ""] {
            assert!(zero_or_more(wrong).is_err(), "{wrong}");
        }
    }
}
