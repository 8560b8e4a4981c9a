//! Arguments that several subcommands share: points, sizes, servers, rigs and plans.

use std::marker::PhantomData;
use std::path::PathBuf;

use argus_client::{Client, ConnectOptions};
use argus_scene::{
    Camera, Effects, Exposure, Holes, Indirect, InvalidField, MapSource, Output, PathKnobs, PlanRequest,
    PointKnobs, Preset, RigKind, RigKnobs, Scene, Search, Visibility, VplKnobs,
};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::parser::ValueSource;
use clap::{ArgMatches, Command, FromArgMatches};
use glam::DVec3;

use crate::credentials;
use crate::exit::bad_arguments;
use crate::settings::{self, Flags, Sources};

/// The address and credentials of the service, for every client subcommand.
#[derive(clap::Args)]
pub(crate) struct Server {
    /// Address of the service [default: ARGUS_SERVER, else http://127.0.0.1:7400]
    #[arg(long, value_name = "URL")]
    server: Option<String>,
    /// PEM file of the certificate authority that signed the service's certificate; needed for https://
    #[arg(long, value_name = "FILE")]
    ca: Option<PathBuf>,
    /// File with this client's access token
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
}

impl Server {
    /// Connects to the service that the settings name, over `connections` connections.
    pub(crate) async fn connect(&self, sources: &Sources, connections: usize) -> anyhow::Result<Client> {
        let (url, options) = self.options(sources)?;
        Ok(Client::connect_with(&url, &ConnectOptions { connections, ..options }).await?)
    }

    /// Returns the service's address and the options of a connection to it.
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

/// A viewpoint that follows from the scene if it is not given.
#[derive(clap::Args, Debug, Clone)]
pub(crate) struct Viewpoint {
    /// Position of the viewer, metres [default: the scene's first recommended viewpoint]
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, requires = "target")]
    eye: Option<DVec3>,
    /// Point that the viewer looks at, metres
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, requires = "eye")]
    target: Option<DVec3>,
    /// Direction that points up in the image [default: 0,1,0]
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, requires = "eye")]
    up: Option<DVec3>,
    /// Vertical field of view, degrees [default: 45, or the recommended viewpoint's]
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    fov_deg: Option<f64>,
    /// Size of the image in pixels
    #[arg(long, value_name = "WxH", default_value = "320x240", value_parser = size)]
    pub(crate) size: [u32; 2],
}

impl Viewpoint {
    /// The camera that the flags or the scene name.
    ///
    /// # Errors
    /// The camera has no image, or the size is 0 or beyond 16384 pixels a side.
    pub(crate) fn camera(&self, scene: &Scene) -> anyhow::Result<Camera> {
        let mut camera = match (self.eye, self.target) {
            (Some(eye), Some(target)) => {
                Camera { up: self.up.unwrap_or(DVec3::Y), ..Camera::look_at(eye, target) }
            }
            _ => scene.default_camera(),
        };
        camera.fov_deg = self.fov_deg.unwrap_or(camera.fov_deg);
        camera.validate()?;
        if self.size.iter().any(|side| !(1..=16384).contains(side)) {
            return Err(bad_arguments("--size: must be 1 to 16384 pixels a side"));
        }
        Ok(camera)
    }
}

/// How sample cameras are placed. A flag that is not given follows from the scene.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Sample cameras")]
pub(crate) struct Rig {
    /// How sample cameras are placed: tile-corners puts four cameras over each tile of a landscape that is seen from
    /// above, cell puts cameras for all directions on a lattice among the viewers [default: by the scene's shape]
    #[arg(long, value_name = "RULE", value_parser = rig_kind())]
    pub(crate) rig: Option<RigKind>,
    /// Number of tiles along x and z; for --rig tile-corners
    #[arg(long, value_name = "XxZ", value_parser = size)]
    pub(crate) tiles: Option<[u32; 2]>,
    /// Size of a sample in texels; more texels show finer detail and cost time and memory; for --rig tile-corners
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub(crate) sample_size: Option<[u32; 2]>,
    /// Spacing of the lattice in metres; a smaller one has fewer holes and needs more samples; for --rig cell
    #[arg(long, value_name = "METRES", value_parser = positive)]
    pub(crate) cell: Option<f64>,
    /// Texels on a side of a sample's cube faces; for --rig cell
    #[arg(long, value_name = "TEXELS")]
    pub(crate) face: Option<u32>,
    /// Number of samples that a view is reconstructed from, unless its request says otherwise
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=8))]
    pub(crate) samples: Option<u32>,
}

impl Rig {
    /// Converts the flags to the rig's settings.
    pub(crate) fn knobs(&self) -> RigKnobs {
        RigKnobs {
            kind: self.rig,
            tiles: self.tiles,
            size: self.sample_size,
            spacing: self.cell,
            face: self.face,
        }
    }
}

/// What samples are rendered from.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Samplers")]
pub(crate) struct SampleSource {
    /// What samples are rendered from: triangles, or megaviews: an octree of the scene that is shaded once for all
    /// samples, without gloss and cut-outs. megaviews implies --rig cell. Direct views always come from triangles
    /// [default: triangles]
    #[arg(long, value_name = "SOURCE", value_parser = argus_scene::Sampling::NAMES)]
    sampling: Option<String>,
    /// Texels on a side of a map's hemisphere, 8 to 1024; for --sampling megaviews [default: 512]
    #[arg(long, value_name = "TEXELS")]
    map_side: Option<u32>,
    /// Levels of the scene's octree, 1 to 10; each further level has cells half as large and takes about four times the
    /// memory; for --sampling megaviews [default: 9]
    #[arg(long, value_name = "N")]
    octree_levels: Option<u32>,
    /// Cameras along the edge of a block that share distant parts of their maps: 1 (nothing is shared), 2 or 4; for
    /// --sampling megaviews [default: 1]
    #[arg(long, value_name = "N")]
    map_block: Option<u32>,
    /// Reflections on glossy and transparent objects: off, or maps (one reflection probe for each object, for views from
    /// samples and for direct views) [default: off]
    #[arg(long, value_name = "KIND", value_parser = ["off", "maps"])]
    reflections: Option<String>,
    /// Texels on a side of a reflection probe: 16, 32, 64, 128 or 256 [default: 64]
    #[arg(long, value_name = "TEXELS")]
    reflection_side: Option<u32>,
    /// Levels of the octree that reflection probes are rendered from, 1 to 10; more levels show finer detail [default: 8]
    #[arg(long, value_name = "N")]
    reflection_levels: Option<u32>,
    /// Greatest number of objects with a reflection probe, 1 to 1024; the largest objects come first [default: 256]
    #[arg(long, value_name = "N")]
    reflectors: Option<u32>,
}

impl SampleSource {
    /// Adds these flags to those of a subcommand.
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
}

/// How samples are placed and rendered.
#[derive(clap::Args, Debug, Clone)]
pub(crate) struct Samples {
    #[command(flatten)]
    pub(crate) rig: Rig,
    #[command(flatten)]
    pub(crate) source: SampleSource,
    #[command(flatten)]
    pub(crate) sampling: Sampling,
    #[command(flatten)]
    pub(crate) visibility: VisibilityArgs,
}

/// How samples are rendered, by all workers alike.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Samplers")]
pub(crate) struct Sampling {
    /// Sub-samples of each texel of a sample: 1, 4 or 16; more of them smooth edges and cost time in proportion
    #[arg(long, value_name = "N", default_value = "4", value_parser = sub_samples())]
    pub(crate) sub_samples: u32,
    /// Effects of light: auto (those that the scene calls for and that may change a pixel by half a byte), all, none (light
    /// passes through surfaces), or some of shadows, soft-shadows, sky-visibility, emitters, with commas between. They cost
    /// rays for each sample and for each view from triangles. `argus scene S --plan` shows what auto chooses, and why
    #[arg(long, value_name = "LIST", default_value = "auto", value_parser = effects)]
    pub(crate) effects: Effects,
    /// Brightness of all views: auto (by the light at visible surfaces), or stops: 0 is the scene's own exposure, and each
    /// stop more doubles the light
    #[arg(long, value_name = "EV", default_value = "auto", allow_negative_numbers = true, value_parser = exposure)]
    pub(crate) exposure: Exposure,
    #[command(flatten)]
    pub(crate) indirect: IndirectLight,
}

/// How surfaces light one another. `argus study radiosity` shows what each flag costs.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Indirect light")]
pub(crate) struct IndirectLight {
    /// Indirect light: auto (paths, where --effects is auto or all and the scene calls for it), off, vpl (gathered from virtual
    /// point lights), points (gathered from small images of an octree of the scene, rendered at some of the visible points) or
    /// paths (the scene's cells exchange light along rays, and some of the visible points gather it; switches on shadows, sky
    /// visibility and emitters). It is computed once a sample and costs warped views nothing. `argus study light` compares them
    #[arg(long, value_name = "METHOD", default_value = "auto", value_parser = ["auto", "off", "vpl", "points", "paths"])]
    pub(crate) indirect: String,
    /// Number of virtual point lights; more of them are smoother and slower
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub(crate) vpls: Option<u32>,
    /// Greatest number of reflections between a light and a visible surface: 1 to 4, with --indirect paths 1 to 16
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=16))]
    pub(crate) bounces: Option<u32>,
    /// Shadow maps of virtual point lights: none, exact (a ray a texel), imperfect (splatted random points), megaviews (an
    /// octree of the scene, rendered for all lights together) or manylods (the same, for each light by itself)
    #[arg(long, value_name = "SOURCE", value_parser = PossibleValuesParser::new(MapSource::ALL.map(MapSource::name)))]
    pub(crate) vpl_maps: Option<String>,
    /// Texels on a side of a hemisphere of a light's shadow map: a power of two, 4 to 256
    #[arg(long, value_name = "TEXELS")]
    pub(crate) vpl_map_side: Option<u32>,
    /// Number of glowing particles: small lights that drift through the scene. Their light is gathered like that of virtual
    /// point lights, with the shadows that --vpl-maps selects
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub(crate) particles: Option<u32>,
    /// Number of virtual point lights that each sub-sample gathers from; more of them mean less noise and more time
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 16))]
    pub(crate) gather: Option<u32>,
    /// Number of light groups, of 256, that a block of the image draws on average, with a probability by the light that they
    /// bring; each drawn group represents those like it. 0 uses every group that may light the block
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=256))]
    pub(crate) vpl_groups: Option<u32>,
    /// Levels of the octree that --indirect points gathers from, 1 to 10
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10))]
    pub(crate) point_levels: Option<u32>,
    /// Texels on a side of a hemisphere of the images that --indirect points gathers from, 8 to 256
    #[arg(long, value_name = "TEXELS", value_parser = clap::value_parser!(u32).range(8..=256))]
    pub(crate) point_map_side: Option<u32>,
    /// Side, in sub-samples, of the blocks that share one or two of those images, 1 to 16
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=16))]
    pub(crate) point_block: Option<u32>,
    /// Cells on a side of the scene for --indirect paths, as a power of two, 1 to 10 [default: 7]. Light leaks by about a
    /// cell along walls. One level more takes about four times the time and memory whenever the scene moves
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10))]
    pub(crate) path_level: Option<u32>,
    /// Rays of each cell's surfaces for --indirect paths, 1 to 256 [default: 4]. Four times as many halve the noise and take
    /// four times the time whenever the scene moves
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256))]
    pub(crate) path_rays: Option<u32>,
    /// Rays of each gathering texel for --indirect paths, 1 to 256 [default: 4]. A quarter of the texels gather. Time is
    /// proportional, for each sample and each view from triangles
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256))]
    pub(crate) path_gather: Option<u32>,
}

impl IndirectLight {
    /// Converts the flags to the sample set's settings.
    ///
    /// # Errors
    /// `--particles` together with `--indirect points` or `paths`, which cannot gather their light; or a knob out of the
    /// method's range.
    pub(crate) fn knobs(&self) -> anyhow::Result<Option<Indirect>> {
        // Particles are gathered like virtual point lights, with which paths do not go.
        let off = self.indirect == "off" || self.indirect == "auto" && self.particles.is_some();
        match (self.indirect.as_str(), self.particles) {
            ("off", None) => return Ok(Some(Indirect::Off)),
            ("auto", None) => return Ok(None),
            _ => {}
        }
        let knobs = match self.indirect.as_str() {
            "points" | "paths" => {
                anyhow::ensure!(
                    self.particles.is_none(),
                    "--particles: their light is gathered like that of virtual point lights; use --indirect vpl or off"
                );
                if self.indirect == "points" { self.points() } else { self.paths() }
            }
            _ => self.virtual_lights(off),
        };
        knobs.validate()?;
        Ok(Some(knobs))
    }

    fn points(&self) -> Indirect {
        let default = PointKnobs::default();
        Indirect::Points(PointKnobs {
            levels: self.point_levels.unwrap_or(default.levels),
            map_side: self.point_map_side.unwrap_or(default.map_side),
            block: self.point_block.unwrap_or(default.block),
            bounces: self.bounces.unwrap_or(default.bounces),
            ..default
        })
    }

    fn paths(&self) -> Indirect {
        let default = PathKnobs::default();
        Indirect::Paths(PathKnobs {
            level: self.path_level.unwrap_or(default.level),
            rays: self.path_rays.unwrap_or(default.rays),
            bounces: self.bounces.unwrap_or(default.bounces),
            gather: self.path_gather.unwrap_or(default.gather),
        })
    }

    /// Virtual point lights, or only particles where indirect light is off.
    fn virtual_lights(&self, off: bool) -> Indirect {
        let default = VplKnobs::default();
        let source = |name: &String| MapSource::ALL.into_iter().find(|source| source.name() == name);
        Indirect::Vpl(VplKnobs {
            vpls: if off { 0 } else { self.vpls.unwrap_or(default.vpls) },
            particles: self.particles.unwrap_or(default.particles),
            bounces: self.bounces.unwrap_or(default.bounces),
            maps: self.vpl_maps.as_ref().and_then(source).unwrap_or(default.maps),
            map_side: self.vpl_map_side.unwrap_or(default.map_side),
            samples: self.gather.unwrap_or(default.samples),
            groups: self.vpl_groups.unwrap_or(default.groups),
            ..default
        })
    }
}

/// The visibility backend of a cluster's workers.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Samplers")]
pub(crate) struct VisibilityArgs {
    /// Visibility backend: raster (the device's rasteriser), trace (packets of rays in compute), cpu (packets of rays
    /// on the processor) or auto (the first worker measures which is cheapest for the scene). Images differ only
    /// along edges
    #[arg(long, value_name = "BACKEND", default_value = AUTO, value_parser = visibility())]
    visibility: Backend,
}

/// A visibility backend; `None`: measured. Through an alias, clap treats it as one value and not as an optional flag.
type Backend = Option<Visibility>;

const AUTO: &str = "auto";

impl VisibilityArgs {
    /// Returns the backend that the user selected, if any.
    pub(crate) fn visibility(&self) -> Option<Visibility> {
        self.visibility
    }
}

fn visibility() -> impl TypedValueParser<Value = Backend> {
    let names = std::iter::once(AUTO).chain(Visibility::ALL.map(Visibility::name));
    PossibleValuesParser::new(names).map(|name| Visibility::ALL.into_iter().find(|v| v.name() == name))
}

/// Flags of `T` that this process passes on to another one.
#[derive(Debug, Clone)]
pub(crate) struct PassedOn<T> {
    /// The flags as they were given.
    pub(crate) arguments: Vec<String>,
    flags: PhantomData<T>,
}

impl<T: clap::Args> FromArgMatches for PassedOn<T> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let mut arguments = Vec::new();
        for flag in T::augment_args(Command::default()).get_arguments() {
            let id = flag.get_id().as_str();
            let given = matches.value_source(id) == Some(ValueSource::CommandLine);
            let values = given.then(|| matches.get_raw(id)).flatten().into_iter().flatten();
            let name = flag.get_long().unwrap_or_default();
            arguments.extend(values.map(|value| format!("--{name}={}", value.display())));
        }
        Ok(Self { arguments, flags: PhantomData })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl<T: clap::Args> clap::Args for PassedOn<T> {
    fn augment_args(command: Command) -> Command {
        T::augment_args(command)
    }

    fn augment_args_for_update(command: Command) -> Command {
        T::augment_args_for_update(command)
    }
}

/// How a view is answered. Without these flags the service chooses the fastest plan that is as good as a direct view.
/// --search, --steps, --samples and --holes ask for samples, and wait until they are rendered.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Plan")]
pub(crate) struct Plan {
    /// Reconstruct from samples, and find the depth of a pixel by: splat (samples are splatted forward; fastest), linear (the
    /// cluster paper's steps along the ray), fixed-point, seeded (fixed-point from a coarse splat) or pyramid (exact)
    #[arg(long, value_name = "SEARCH", value_parser = search())]
    pub(crate) search: Option<Search>,
    /// Steps of the linear, fixed-point and seeded searches, 1 to 4096; more steps find more surfaces and cost time
    #[arg(long, value_name = "N")]
    pub(crate) steps: Option<u32>,
    /// Render from the triangles, never from samples. This also fixes the plan: a plan that is left open depends on what the
    /// workers hold, and so on other viewers
    #[arg(long)]
    pub(crate) direct: bool,
    /// Sub-pixels on a side of each pixel, 1 to 8; N costs about N² times as much
    #[arg(long, value_name = "N")]
    pub(crate) supersampling: Option<u32>,
    /// Reconstruct from at most this many samples, 1 to 8
    #[arg(long, value_name = "N")]
    pub(crate) samples: Option<u32>,
    /// Pixels that no sample saw: mark (guess their colour and set them in the mask) or trace (trace their
    /// rays, which costs time)
    #[arg(long, value_name = "HOW", value_parser = holes())]
    pub(crate) holes: Option<Holes>,
    /// Goal of the plan: interactive (least time), balanced (the fastest image that is as good as a direct view; the
    /// default) or exact (no guessed pixel, four samples a pixel)
    #[arg(long, value_name = "GOAL", value_parser = preset())]
    pub(crate) preset: Option<Preset>,
    /// Greatest accepted mean FLIP error against the reference, above 0 and up to 1. `argus study bounds` calibrates the
    /// scene, so that the cheapest plan that keeps the bound is taken
    #[arg(long, value_name = "FLIP", allow_negative_numbers = true)]
    pub(crate) max_error: Option<f64>,
    /// Milliseconds that the answer may take; the service chooses the plan with the least error that is
    /// expected to keep it
    #[arg(long, value_name = "MS", allow_negative_numbers = true)]
    pub(crate) deadline_ms: Option<f64>,
}

impl Plan {
    /// Converts the flags to a plan request.
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

fn rig_kind() -> impl TypedValueParser<Value = RigKind> {
    PossibleValuesParser::new(["tile-corners", "cell"]).map(|name| match name.as_str() {
        "cell" => RigKind::Cell,
        _ => RigKind::TileCorners,
    })
}

/// Parses `auto` or a number of stops.
pub(crate) fn exposure(text: &str) -> Result<Exposure, InvalidField> {
    text.parse()
}

/// Parses `auto`, `all`, `none`, or names of effects.
pub(crate) fn effects(text: &str) -> Result<Effects, InvalidField> {
    text.parse()
}

fn sub_samples() -> impl TypedValueParser<Value = u32> {
    PossibleValuesParser::new(["1", "4", "16"]).map(|number| match number.as_str() {
        "1" => 1,
        "16" => 16,
        _ => 4,
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

/// Parses `X,Y,Z`. Infinite and NaN numbers pass: the service names the invalid field.
pub(crate) fn point(text: &str) -> Result<DVec3, String> {
    let parts = text.split(',').map(|part| part.trim().parse::<f64>()).collect::<Result<Vec<_>, _>>();
    match parts.as_deref() {
        Ok(&[x, y, z]) => Ok(DVec3::new(x, y, z)),
        _ => Err("must be three numbers separated by commas, such as 3,2.5,-1".to_owned()),
    }
}

/// Parses `WIDTHxHEIGHT`. Zero passes: the service names the limits.
pub(crate) fn size(text: &str) -> Result<[u32; 2], String> {
    let sides = text.split_once(['x', 'X']).map(|(w, h)| (w.trim().parse(), h.trim().parse()));
    match sides {
        Some((Ok(width), Ok(height))) => Ok([width, height]),
        _ => Err("must be two whole numbers separated by x, such as 640x480".to_owned()),
    }
}

/// Parses a finite number above zero.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
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
    fn flags_are_passed_on_as_they_were_given() {
        #[derive(clap::Parser)]
        struct Program {
            #[command(flatten)]
            samples: PassedOn<Samples>,
        }
        let passed = |flags: &[&str]| {
            let words = ["program"].iter().chain(flags);
            <Program as clap::Parser>::try_parse_from(words).map(|program| program.samples.arguments)
        };
        let all = ["--rig=cell", "--tiles=4X2", "--cell=0.50", "--sampling=megaviews", "--particles=9"];
        assert_eq!(passed(&all).unwrap(), all);
        assert_eq!(passed(&["--sub-samples", "16"]).unwrap(), ["--sub-samples=16"]);
        assert_eq!(passed(&["--effects", "shadows,emitters"]).unwrap(), ["--effects=shadows,emitters"]);
        assert!(passed(&["--effects", "shadow"]).is_err_and(|error| error.to_string().contains("`shadow`")));
        assert!(passed(&[]).unwrap().is_empty());
        assert!(passed(&["--rig", "sphere"]).is_err());
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
