//! What several subcommands take: points, sizes, servers, rigs and plans.

use std::path::PathBuf;

use argus_client::{Client, ConnectOptions};
use argus_sampler::{Indirect, MapSource, PointKnobs, SamplerKnobs, VplKnobs};
use argus_scene::{Holes, Output, PlanRequest, Preset, RigKind, RigKnobs, Search, Visibility};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use glam::DVec3;

use crate::credentials;
use crate::settings::{self, Flags, Sources};

/// Where the service is, for every subcommand that is a client.
#[derive(clap::Args)]
pub(crate) struct Server {
    /// Where the service is [default: ARGUS_SERVER, else http://127.0.0.1:7400]
    #[arg(long, value_name = "URL")]
    server: Option<String>,
    /// PEM file of the authority that signed the service's certificate, for https://
    #[arg(long, value_name = "FILE")]
    ca: Option<PathBuf>,
    /// File that holds this client's token
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
}

impl Server {
    /// A client of the service that the settings name, over so many connections.
    pub(crate) async fn connect(&self, sources: &Sources, connections: usize) -> anyhow::Result<Client> {
        let (url, options) = self.options(sources)?;
        Ok(Client::connect_with(&url, &ConnectOptions { connections, ..options }).await?)
    }

    /// Where the service is, and how it is connected to.
    pub(crate) fn options(&self, sources: &Sources) -> anyhow::Result<(String, ConnectOptions)> {
        let flags = Flags::default()
            .with("client.server", "--server", self.server.as_ref())
            .with("client.ca", "--ca", settings::path(self.ca.as_ref()))
            .with("client.token_file", "--token-file", settings::path(self.token_file.as_ref()));
        let settings = sources.load(flags)?.settings.client;
        let options = credentials::of_client(&settings)?;
        Ok((settings.server, options))
    }
}

/// Certificates of a process of the cluster.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Security (`argus certs` makes the files)")]
pub(crate) struct Security {
    /// PEM file of this process's certificate; with it, all that it listens on and connects to is TLS
    #[arg(long, value_name = "FILE")]
    certificate: Option<PathBuf>,
    /// PEM file of the certificate's key
    #[arg(long, value_name = "FILE")]
    key: Option<PathBuf>,
    /// PEM file of the authority that signs the certificates of the cluster's processes
    #[arg(long, value_name = "FILE")]
    ca: Option<PathBuf>,
    /// Listen beyond this machine without TLS, for whoever can reach it
    #[arg(long)]
    insecure: bool,
}

impl Security {
    /// Among the flags of a subcommand.
    pub(crate) fn with(&self, flags: Flags) -> Flags {
        flags
            .with("security.certificate", "--certificate", settings::path(self.certificate.as_ref()))
            .with("security.key", "--key", settings::path(self.key.as_ref()))
            .with("security.ca", "--ca", settings::path(self.ca.as_ref()))
            .with("security.insecure", "--insecure", self.insecure.then_some(true))
    }
}

/// How sample cameras are placed; what is left out follows from the scene.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Sample cameras")]
pub(crate) struct Rig {
    /// Rule of placement: four cameras over each tile (landscapes seen from outside) or omni cameras on a
    /// lattice (interiors)
    #[arg(long, value_name = "RULE", value_parser = rig_kind())]
    pub(crate) rig: Option<RigKind>,
    /// Tiles along x and z, for tile-corners
    #[arg(long, value_name = "XxZ", value_parser = size)]
    pub(crate) tiles: Option<[u32; 2]>,
    /// Texels of a sample, for tile-corners
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub(crate) sample_size: Option<[u32; 2]>,
    /// Edge of a cell in metres, for cell
    #[arg(long, value_name = "METRES", value_parser = positive)]
    pub(crate) cell: Option<f64>,
    /// Side of a cube face in texels, for cell
    #[arg(long, value_name = "TEXELS")]
    pub(crate) face: Option<u32>,
    /// Samples that a view is reconstructed from where its request leaves it open
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=8))]
    pub(crate) samples: Option<u32>,
}

impl Rig {
    /// The rig's part of them, in the vocabulary's words.
    pub(crate) fn knobs(&self) -> RigKnobs {
        RigKnobs {
            kind: self.rig,
            tiles: self.tiles,
            size: self.sample_size,
            spacing: self.cell,
            face: self.face,
        }
    }

    /// The same knobs as arguments of a subcommand that runs in a process of its own.
    pub(crate) fn to_arguments(&self) -> Vec<String> {
        let pair = |[a, b]: [u32; 2]| format!("{a}x{b}");
        let rig = self.rig.map(|kind| RIGS[usize::from(kind == RigKind::Cell)].to_owned());
        let values = [
            ("--rig", rig),
            ("--tiles", self.tiles.map(pair)),
            ("--sample-size", self.sample_size.map(pair)),
            ("--cell", self.cell.map(|metres| metres.to_string())),
            ("--face", self.face.map(|texels| texels.to_string())),
            ("--samples", self.samples.map(|n| n.to_string())),
        ];
        values.into_iter().filter_map(|(name, value)| value.map(|v| format!("{name}={v}"))).collect()
    }
}

/// What samples are rendered from.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Samplers")]
pub(crate) struct SampleSource {
    /// What samples are rendered from: the triangles, each sample by itself, or maps of an octree of the scene, whose
    /// surfaces are shaded once for all of them; megaviews takes omni cameras, and --rig cell by itself. Direct views
    /// and single pixels come from triangles always [default: triangles]
    #[arg(long, value_name = "WAY", value_parser = argus_scene::Sampling::NAMES)]
    sampling: Option<String>,
    /// Texels on a side of a map's hemisphere, for megaviews: 8 to 1024 [default: 512]
    #[arg(long, value_name = "TEXELS")]
    map_side: Option<u32>,
    /// Levels of the scene's octree, for megaviews: 1 to 10 [default: 9]
    #[arg(long, value_name = "N")]
    octree_levels: Option<u32>,
    /// Cameras along an edge of the block whose maps are rendered together and share what looks alike from them, for
    /// megaviews: 1, where each has its own, 2 or 4 [default: 1]
    #[arg(long, value_name = "N")]
    map_block: Option<u32>,
    /// What glossy and transparent things show of the scene around them: off, or maps, one around each of them, of an
    /// octree of the scene; direct views, too [default: off]
    #[arg(long, value_name = "WAY", value_parser = ["off", "maps"])]
    reflections: Option<String>,
    /// Texels on a side of such a map: 16, 32, 64, 128 or 256 [default: 64]
    #[arg(long, value_name = "TEXELS")]
    reflection_side: Option<u32>,
    /// Levels of the octree that they show: 1 to 10 [default: 8]
    #[arg(long, value_name = "N")]
    reflection_levels: Option<u32>,
    /// Things that have a map, the largest first: 1 to 1024 [default: 256]
    #[arg(long, value_name = "N")]
    reflectors: Option<u32>,
}

impl SampleSource {
    /// Among the flags of a subcommand.
    pub(crate) fn with(&self, flags: Flags) -> Flags {
        flags
            .with("coordinator.sampling", "--sampling", self.sampling.as_ref())
            .with("coordinator.map_side", "--map-side", self.map_side)
            .with("coordinator.octree_levels", "--octree-levels", self.octree_levels)
            .with("coordinator.map_block", "--map-block", self.map_block)
            .with("coordinator.reflections", "--reflections", self.reflections.as_ref())
            .with("coordinator.reflection_side", "--reflection-side", self.reflection_side)
            .with("coordinator.reflection_levels", "--reflection-levels", self.reflection_levels)
            .with("coordinator.reflectors", "--reflectors", self.reflectors)
    }

    /// The same as arguments of a subcommand that runs in a process of its own.
    pub(crate) fn to_arguments(&self) -> Vec<String> {
        let number = |n: Option<u32>| n.map(|n| n.to_string());
        let values = [
            ("--sampling", self.sampling.clone()),
            ("--map-side", number(self.map_side)),
            ("--octree-levels", number(self.octree_levels)),
            ("--map-block", number(self.map_block)),
            ("--reflections", self.reflections.clone()),
            ("--reflection-side", number(self.reflection_side)),
            ("--reflection-levels", number(self.reflection_levels)),
            ("--reflectors", number(self.reflectors)),
        ];
        values.into_iter().filter_map(|(name, value)| value.map(|v| format!("{name}={v}"))).collect()
    }
}

/// How workers render samples.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Samplers")]
pub(crate) struct Sampling {
    /// Sub-samples of a texel of a sample: 1, 4 or 16
    #[arg(long, value_name = "N", default_value = "4", value_parser = ["1", "4", "16"])]
    pub(crate) sub_samples: String,
    #[command(flatten)]
    pub(crate) indirect: IndirectLight,
}

/// How surfaces light one another. `argus study radiosity` shows what each of the knobs costs.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Indirect light")]
pub(crate) struct IndirectLight {
    /// Light that surfaces reflect onto one another, and that surfaces emit, found once per sample: none (off), gathered
    /// from virtual point lights (vpl), or from small images of an octree of the scene that some of what is visible
    /// sees (points)
    #[arg(long, value_name = "WAY", default_value = "off", value_parser = ["off", "vpl", "points"])]
    pub(crate) indirect: String,
    /// Virtual point lights
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub(crate) vpls: Option<u32>,
    /// Reflections between a light and what is seen, at most
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4))]
    pub(crate) bounces: Option<u32>,
    /// Where shadows of virtual point lights come from: nowhere, rays through the centres of maps' texels, random
    /// points splatted into maps, or an octree of the scene, rendered for all of them together or for each by itself
    #[arg(long, value_name = "SOURCE", value_parser = PossibleValuesParser::new(MapSource::ALL.map(MapSource::name)))]
    pub(crate) vpl_maps: Option<String>,
    /// Texels on a side of a hemisphere of such a map: a power of two, 4 to 256
    #[arg(long, value_name = "TEXELS")]
    pub(crate) vpl_map_side: Option<u32>,
    /// Glowing particles: small lights that drift through the scene and shine everywhere, with the shadows that
    /// --vpl-maps makes; their light is gathered like that of virtual point lights, and --indirect off has that of
    /// particles alone
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub(crate) particles: Option<u32>,
    /// Virtual point lights that each sub-sample gathers from
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 16))]
    pub(crate) gather: Option<u32>,
    /// Groups of virtual point lights, of 256, that a block of the image gathers from on average, drawn by how much light
    /// they bring, each in the stead of those like it; 0: all that may light the block
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=256))]
    pub(crate) vpl_groups: Option<u32>,
    /// Levels of the octree whose small images are seen, below its root
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10))]
    pub(crate) point_levels: Option<u32>,
    /// Texels on a side of a hemisphere of such an image: 8 to 256
    #[arg(long, value_name = "TEXELS", value_parser = clap::value_parser!(u32).range(8..=256))]
    pub(crate) point_map_side: Option<u32>,
    /// Sub-samples on a side of the blocks that see one or two such images
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=16))]
    pub(crate) point_block: Option<u32>,
}

impl IndirectLight {
    /// In the sampler's words.
    ///
    /// # Errors
    /// Particles where nothing gathers their light.
    pub(crate) fn knobs(&self) -> anyhow::Result<Indirect> {
        let off = self.indirect == "off";
        if off && self.particles.is_none() {
            return Ok(Indirect::Off);
        }
        if self.indirect == "points" {
            anyhow::ensure!(
                self.particles.is_none(),
                "--particles: their light is gathered like that of virtual point lights; use --indirect vpl or off"
            );
            let default = PointKnobs::default();
            return Ok(Indirect::Points(PointKnobs {
                levels: self.point_levels.unwrap_or(default.levels),
                map_side: self.point_map_side.unwrap_or(default.map_side),
                block: self.point_block.unwrap_or(default.block),
                bounces: self.bounces.unwrap_or(default.bounces),
                ..default
            }));
        }
        let default = VplKnobs::default();
        let source = |name: &String| MapSource::ALL.into_iter().find(|source| source.name() == name);
        Ok(Indirect::Vpl(VplKnobs {
            vpls: if off { 0 } else { self.vpls.unwrap_or(default.vpls) },
            particles: self.particles.unwrap_or(default.particles),
            bounces: self.bounces.unwrap_or(default.bounces),
            maps: self.vpl_maps.as_ref().and_then(source).unwrap_or(default.maps),
            map_side: self.vpl_map_side.unwrap_or(default.map_side),
            samples: self.gather.unwrap_or(default.samples),
            groups: self.vpl_groups.unwrap_or(default.groups),
            ..default
        }))
    }

    /// The same as arguments of a subcommand that runs in a process of its own.
    pub(crate) fn to_arguments(&self) -> Vec<String> {
        let number = |n: Option<u32>| n.map(|n| n.to_string());
        let values = [
            ("--indirect", Some(self.indirect.clone())),
            ("--vpls", number(self.vpls)),
            ("--bounces", number(self.bounces)),
            ("--vpl-maps", self.vpl_maps.clone()),
            ("--vpl-map-side", number(self.vpl_map_side)),
            ("--particles", number(self.particles)),
            ("--gather", number(self.gather)),
            ("--vpl-groups", number(self.vpl_groups)),
            ("--point-levels", number(self.point_levels)),
            ("--point-map-side", number(self.point_map_side)),
            ("--point-block", number(self.point_block)),
        ];
        values.into_iter().filter_map(|(name, value)| value.map(|v| format!("{name}={v}"))).collect()
    }
}

impl Sampling {
    /// In the sampler's words.
    ///
    /// # Errors
    /// Flags that do not go together.
    pub(crate) fn knobs(&self) -> anyhow::Result<SamplerKnobs> {
        let default = SamplerKnobs::default();
        let sub_samples = self.sub_samples.parse().unwrap_or(default.sub_samples);
        Ok(SamplerKnobs { sub_samples, indirect: self.indirect.knobs()?, ..default })
    }

    /// The same as arguments of a subcommand that runs in a process of its own.
    pub(crate) fn to_arguments(&self) -> Vec<String> {
        let mut arguments = vec![format!("--sub-samples={}", self.sub_samples)];
        arguments.extend(self.indirect.to_arguments());
        arguments
    }
}

/// How the workers of a cluster see triangles.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Samplers")]
pub(crate) struct Seeing {
    /// How triangles are seen: by the device's rasteriser, by packets of rays in compute (trace) or on the processor
    /// (cpu), or by whichever of them the first worker measures to be cheapest for the scene (auto). Ways may differ
    /// along edges
    #[arg(long, value_name = "WAY", default_value = AUTO, value_parser = visibility())]
    visibility: Way,
}

/// A way to see triangles; none where it is to be measured.
type Way = Option<Visibility>;

const AUTO: &str = "auto";

impl Seeing {
    /// The way, if the user said which.
    pub(crate) fn visibility(&self) -> Way {
        self.visibility
    }

    /// The same as arguments of a subcommand that runs in a process of its own.
    pub(crate) fn to_arguments(&self) -> Vec<String> {
        vec![format!("--visibility={}", self.visibility.map_or(AUTO, Visibility::name))]
    }
}

fn visibility() -> impl TypedValueParser<Value = Way> {
    let names = std::iter::once(AUTO).chain(Visibility::ALL.map(Visibility::name));
    PossibleValuesParser::new(names).map(|name| Visibility::ALL.into_iter().find(|v| v.name() == name))
}

/// How a view is to be answered. Without any of these, the service answers at once: from the triangles, or from samples that a
/// worker holds where that is sooner and as good. --search, --steps, --samples and --holes ask for samples and wait for them.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Plan")]
pub(crate) struct Plan {
    /// How the depth of a pixel is found: by splatting the samples forward (fast), by the cluster paper's linear steps
    /// along the ray, by fixed-point steps, by those from a coarse splat (seeded), or exactly, through levels (pyramid)
    #[arg(long, value_name = "SEARCH", value_parser = search())]
    pub(crate) search: Option<Search>,
    /// Steps of the linear, fixed-point and seeded searches, 1 to 4096
    #[arg(long, value_name = "N")]
    pub(crate) steps: Option<u32>,
    /// Render from the triangles: the exact answer, and the baseline
    #[arg(long)]
    pub(crate) direct: bool,
    /// Average each pixel from this many a side, 1 to 8
    #[arg(long, value_name = "N")]
    pub(crate) supersampling: Option<u32>,
    /// Reconstruct from at most this many samples, 1 to 8
    #[arg(long, value_name = "N")]
    pub(crate) samples: Option<u32>,
    /// What becomes of pixels that no sample saw: a guess that the mask marks, or their rays traced
    #[arg(long, value_name = "WAY", value_parser = holes())]
    pub(crate) holes: Option<Holes>,
    /// What matters: interactive (time before error), balanced (as good as the triangles, as soon as can be; the default) or
    /// exact (no pixel is guessed, four samples a pixel)
    #[arg(long, value_name = "WISH", value_parser = preset())]
    pub(crate) preset: Option<Preset>,
    /// Greatest mean FLIP against the reference that is accepted, above 0 and up to 1; a scene that `argus study
    /// bounds` has calibrated is answered at the least cost that keeps it
    #[arg(long, value_name = "FLIP", allow_negative_numbers = true)]
    pub(crate) max_error: Option<f64>,
    /// Milliseconds that rendering may take; the best that is expected to be done by then
    #[arg(long, value_name = "MS", allow_negative_numbers = true)]
    pub(crate) deadline_ms: Option<f64>,
}

impl Plan {
    /// In the vocabulary's words.
    pub(crate) fn request(&self) -> PlanRequest {
        PlanRequest {
            direct: self.direct,
            search: self.search,
            steps: self.steps,
            supersampling: self.supersampling,
            samples: self.samples,
            holes: self.holes,
            preset: self.preset,
            max_error: self.max_error,
            deadline_ms: self.deadline_ms,
        }
    }
}

const RIGS: [&str; 2] = ["tile-corners", "cell"];

fn rig_kind() -> impl TypedValueParser<Value = RigKind> {
    PossibleValuesParser::new(RIGS).map(|name| match name.as_str() {
        "cell" => RigKind::Cell,
        _ => RigKind::TileCorners,
    })
}

pub(crate) fn search() -> impl TypedValueParser<Value = Search> {
    PossibleValuesParser::new(Search::ALL.map(Search::name))
        .map(|name| Search::ALL.into_iter().find(|s| s.name() == name).unwrap_or_default())
}

fn holes() -> impl TypedValueParser<Value = Holes> {
    PossibleValuesParser::new(["mark", "trace"]).map(|name| match name.as_str() {
        "trace" => Holes::Trace,
        _ => Holes::Mark,
    })
}

const PRESETS: [(&str, Preset); 3] =
    [("interactive", Preset::Interactive), ("balanced", Preset::Balanced), ("exact", Preset::Exact)];

fn preset() -> impl TypedValueParser<Value = Preset> {
    PossibleValuesParser::new(PRESETS.map(|(name, _)| name)).map(|name| {
        PRESETS.into_iter().find(|(known, _)| *known == name).map_or(Preset::Balanced, |(_, preset)| preset)
    })
}

/// Parses the name of one image of a frame.
pub(crate) fn output() -> impl TypedValueParser<Value = Output> {
    PossibleValuesParser::new(Output::ALL.map(Output::name))
        .map(|name| Output::ALL.into_iter().find(|o| o.name() == name).unwrap_or(Output::Color))
}

/// Parses `X,Y,Z`. Numbers that are not finite pass: the service says which field is at fault.
pub(crate) fn point(text: &str) -> Result<DVec3, String> {
    let parts = text.split(',').map(|part| part.trim().parse::<f64>()).collect::<Result<Vec<_>, _>>();
    match parts.as_deref() {
        Ok(&[x, y, z]) => Ok(DVec3::new(x, y, z)),
        _ => Err("three numbers with commas between them are wanted, such as 3,2.5,-1".to_owned()),
    }
}

/// Parses `WIDTHxHEIGHT`. Zero passes: the service says which sides it accepts.
pub(crate) fn size(text: &str) -> Result<[u32; 2], String> {
    let sides = text.split_once(['x', 'X']).map(|(w, h)| (w.trim().parse(), h.trim().parse()));
    match sides {
        Some((Ok(width), Ok(height))) => Ok([width, height]),
        _ => Err("two whole numbers with an x between them are wanted, such as 640x480".to_owned()),
    }
}

/// Parses a finite number above zero.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number > 0.0 && number.is_finite() => Ok(number),
        _ => Err("a finite number above 0 is wanted".to_owned()),
    }
}

/// Parses a number from 0 to 1.
pub(crate) fn share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if (0.0..=1.0).contains(&number) => Ok(number),
        _ => Err("a number from 0 to 1 is wanted".to_owned()),
    }
}

/// Parses a finite number that is not below zero.
pub(crate) fn zero_or_more(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number >= 0.0 && number.is_finite() => Ok(number),
        _ => Err("a finite number, 0 or above, is wanted".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_take_signs_spaces_and_numbers_that_are_not_finite() {
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
