//! Flags of how samples are placed and rendered, by all workers alike.

use argus_sampler::plug::missing;
use argus_scene::{
    CellSettings, Effects, Exposure, Indirect, InvalidField, LightRequest, MapSource, PathSettings,
    PointSettings, RigKind, RigSettings, Visibility, VplSettings,
};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

use super::{positive, size};
use crate::settings::{Flags, HAS_PAPERS};

/// How sample cameras are placed. A flag that is not given follows from the scene.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Sample cameras")]
pub struct Rig {
    /// How sample cameras are placed: tile-corners puts four cameras over each tile of a landscape that is seen from
    /// above, cell puts cameras for all directions on a lattice among the viewers [default: by the scene's shape]
    #[arg(long, value_name = "RULE", value_parser = rig_kind())]
    pub rig: Option<RigKind>,
    /// Number of tiles along x and z; for --rig tile-corners
    #[arg(long, value_name = "XxZ", value_parser = size)]
    pub tiles: Option<[u32; 2]>,
    /// Size of a sample in texels; more texels show finer detail and cost time and memory; for --rig tile-corners
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub sample_size: Option<[u32; 2]>,
    /// Spacing of the lattice in metres; a smaller one has fewer holes and needs more samples; for --rig cell
    #[arg(long, value_name = "METRES", value_parser = positive)]
    pub cell: Option<f64>,
    /// Texels on a side of a sample's cube faces; for --rig cell
    #[arg(long, value_name = "TEXELS")]
    pub face: Option<u32>,
    /// Number of samples that a view is reconstructed from, unless its request says otherwise
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=8))]
    pub samples: Option<u32>,
}

impl Rig {
    /// Converts the flags to the rig's settings.
    pub fn settings(&self) -> RigSettings {
        RigSettings {
            kind: self.rig,
            tiles: self.tiles,
            size: self.sample_size,
            spacing: self.cell,
            face: self.face,
        }
    }

    /// The number of samples of a view, or `usual`.
    pub fn samples(&self, usual: usize) -> usize {
        self.samples.map_or(usual, |samples| samples as usize)
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
    /// Reflections on glossy and transparent objects: auto (the cheapest, where the scene calls for them), off (only lights
    /// and the sky), rays (traced), points (from the scene's triangles, as dense as viewers see them) or maps (from an octree of
    /// the scene). Views from samples look up a reflection probe for each object. `argus scene S --plan` shows what auto takes
    /// [default: auto]
    #[arg(long, value_name = "KIND", value_parser = ["auto", "off", "rays", "points", "maps"])]
    reflections: Option<String>,
    /// Texels on a side of a reflection probe: 16, 32, 64, 128 or 256 [default: 64]
    #[arg(long, value_name = "TEXELS")]
    reflection_side: Option<u32>,
    /// Levels of the octree that reflection probes are rendered from, 1 to 10; more levels show finer detail [default: 8]
    #[arg(long, value_name = "N")]
    reflection_levels: Option<u32>,
    /// Most points that fill reflection probes at once, 1024 to 134217728, of 8 bytes each. Where more are wanted, reflections
    /// are coarser, and the worker logs it; for --reflections points [default: 4194304]
    #[arg(long, value_name = "N")]
    reflection_points: Option<u32>,
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
            .with("coordinator.reflection_points", "--reflection-points", self.reflection_points)
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

/// How a service renders, without where its samples stand.
#[derive(clap::Args, Debug, Clone)]
pub(crate) struct Rendering {
    #[command(flatten)]
    source: SampleSource,
    #[command(flatten)]
    sampling: Sampling,
    #[command(flatten)]
    visibility: VisibilityArgs,
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
    /// Light of the scene: auto (the first of the following that reaches most of what is seen), file (its own lights, emitting
    /// surfaces and environment), sky (with a sun and a sky), or interior (with an even light that is blocked only by what is
    /// near). `argus scene S --plan` shows what auto takes, and why
    #[arg(long, value_name = "LIGHT", default_value = "auto", value_parser = light)]
    pub(crate) light: LightRequest,
    /// Brightness of all views: auto (by the light at visible surfaces), or stops: 0 is the scene's own exposure, and each
    /// stop more doubles the light
    #[arg(long, value_name = "EV", default_value = "auto", allow_negative_numbers = true, value_parser = exposure)]
    pub(crate) exposure: Exposure,
    #[command(flatten)]
    pub(crate) indirect: IndirectLight,
}

/// The values of `--indirect`.
fn indirect_methods() -> PossibleValuesParser {
    let old = PossibleValue::new("paths").hide(true);
    let named = ["auto", "off", "cells", "gather", "vpl", "points"].map(PossibleValue::new);
    PossibleValuesParser::new(named.into_iter().chain([old]))
}

/// How surfaces light one another. `argus-lab study method virtual-lights` shows what each flag costs.
#[derive(clap::Args, Debug, Clone)]
#[command(next_help_heading = "Indirect light")]
pub(crate) struct IndirectLight {
    /// Indirect light: auto (cells, where --effects is auto or all and the scene calls for it), off, cells (light cells: it is
    /// gathered once on surfaces, together with the sky's, and looked up by all views; rays light views until their cells are
    /// filled), gather (parts of the scene exchange light along rays, and some of the visible points of each view and sample gather
    /// it; it was called paths), vpl (gathered from virtual point lights) or points (gathered from small images of an octree of the
    /// scene, rendered at some of the visible points). Cells and gather switch on shadows, sky visibility and emitters. `argus-lab
    /// study light indirect` compares them
    #[arg(long, value_name = "METHOD", default_value = "auto", value_parser = indirect_methods())]
    pub(crate) indirect: String,
    /// Number of virtual point lights; more of them are smoother and slower
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub(crate) vpls: Option<u32>,
    /// Greatest number of reflections between a light and a visible surface: 1 to 4, with --indirect gather or cells 1 to 16;
    /// cells with 0 keep what is seen of the sky alone
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=16))]
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
    /// Cells on a side of the scene for --indirect gather, as a power of two, 1 to 9 [default: 7]. Light leaks by about a
    /// cell along walls. One level more takes about four times the time and memory whenever the scene moves
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=9))]
    pub(crate) path_level: Option<u32>,
    /// Rays of each cell's surfaces for --indirect gather, 1 to 256 [default: 4]. Four times as many halve the noise and take
    /// four times the time whenever the scene moves
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256))]
    pub(crate) path_rays: Option<u32>,
    /// Rays of each gathering texel for --indirect gather, 1 to 256 [default: 4]. A quarter of the texels gather. Time is
    /// proportional, for each sample and each view from triangles
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256))]
    pub(crate) path_gather: Option<u32>,
    /// Edge of a light cell of --indirect cells, in pixels of the view, 1 to 64 [default: 4]. Twice as much takes a quarter of the
    /// time to fill, and blurs light over twice the distance
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(1..=64))]
    pub(crate) cell_pixels: Option<u32>,
    /// Rays of each side of a light cell at best: 16, 64 or 256 [default: 256]. Views begin with 16; cells in use are refined while
    /// nothing else is to do. Four times as many halve the noise
    #[arg(long, value_name = "N")]
    pub(crate) cell_rays: Option<u32>,
}

impl IndirectLight {
    /// Converts the flags to the sample set's settings.
    ///
    /// # Errors
    /// `--particles` together with `--indirect points`, `gather` or `cells`, which cannot gather their light; a setting without its
    /// method, or out of its range.
    pub(crate) fn settings(&self) -> anyhow::Result<Option<Indirect>> {
        // Particles are gathered like virtual point lights, with which paths do not go.
        let off = self.indirect == "off" || self.indirect == "auto" && self.particles.is_some();
        let method = match (self.indirect.as_str(), self.particles) {
            ("off" | "auto", Some(_)) => "vpl",
            ("paths", _) => "gather",
            (method, _) => method,
        };
        if let Some((flag, methods)) = self.not_of(method) {
            anyhow::bail!("{flag}: --indirect {method} does not take it; use --indirect {methods}");
        }
        match method {
            "off" => return Ok(Some(Indirect::Off)),
            "auto" => return Ok(None),
            _ => {}
        }
        let settings = match self.indirect.as_str() {
            "points" | "gather" | "paths" | "cells" => {
                anyhow::ensure!(
                    self.particles.is_none(),
                    "--particles: their light is gathered like that of virtual point lights; use --indirect vpl or off"
                );
                match self.indirect.as_str() {
                    "points" => self.points(),
                    "cells" => self.cells(),
                    _ => Indirect::Paths(self.paths()),
                }
            }
            _ => self.virtual_lights(off),
        };
        settings.validate()?;
        let of_papers = matches!(settings, Indirect::Vpl(_) | Indirect::Points(_));
        if of_papers && !HAS_PAPERS {
            return Err(match self.particles {
                Some(count) => missing("--particles", &count.to_string()),
                None => missing("--indirect", &self.indirect),
            }
            .into());
        }
        Ok(Some(settings))
    }

    /// The first setting that is given and that a method does not take, with the methods that do.
    fn not_of(&self, method: &str) -> Option<(&'static str, &'static str)> {
        let settings = [
            ("--bounces", self.bounces.is_some(), "cells, gather, vpl or points"),
            ("--cell-pixels", self.cell_pixels.is_some(), "cells"),
            ("--cell-rays", self.cell_rays.is_some(), "cells"),
            ("--path-level", self.path_level.is_some(), "cells or gather"),
            ("--path-rays", self.path_rays.is_some(), "cells or gather"),
            ("--path-gather", self.path_gather.is_some(), "cells or gather"),
            ("--vpls", self.vpls.is_some(), "vpl"),
            ("--vpl-maps", self.vpl_maps.is_some(), "vpl"),
            ("--vpl-map-side", self.vpl_map_side.is_some(), "vpl"),
            ("--vpl-groups", self.vpl_groups.is_some(), "vpl"),
            ("--gather", self.gather.is_some(), "vpl"),
            ("--point-levels", self.point_levels.is_some(), "points"),
            ("--point-map-side", self.point_map_side.is_some(), "points"),
            ("--point-block", self.point_block.is_some(), "points"),
        ];
        let takes = |methods: &str| methods.split([',', ' ']).any(|one| one == method);
        let (flag, _, methods) =
            settings.into_iter().find(|(_, is_given, methods)| *is_given && !takes(methods))?;
        Some((flag, methods))
    }

    fn points(&self) -> Indirect {
        let default = PointSettings::default();
        Indirect::Points(PointSettings {
            levels: self.point_levels.unwrap_or(default.levels),
            map_side: self.point_map_side.unwrap_or(default.map_side),
            block: self.point_block.unwrap_or(default.block),
            bounces: self.bounces.unwrap_or(default.bounces),
            ..default
        })
    }

    fn cells(&self) -> Indirect {
        let default = CellSettings::default();
        Indirect::Cells(CellSettings {
            paths: self.paths(),
            pixels: self.cell_pixels.unwrap_or(default.pixels),
            rays: self.cell_rays.unwrap_or(default.rays),
        })
    }

    fn paths(&self) -> PathSettings {
        let default = PathSettings::default();
        PathSettings {
            level: self.path_level.unwrap_or(default.level),
            rays: self.path_rays.unwrap_or(default.rays),
            bounces: self.bounces.unwrap_or(default.bounces),
            gather: self.path_gather.unwrap_or(default.gather),
        }
    }

    /// Virtual point lights, or only particles where indirect light is off.
    fn virtual_lights(&self, off: bool) -> Indirect {
        let default = VplSettings::default();
        let source = |name: &String| MapSource::ALL.into_iter().find(|source| source.name() == name);
        Indirect::Vpl(VplSettings {
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

/// Parses the name of a light.
pub(crate) fn light(text: &str) -> Result<LightRequest, InvalidField> {
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

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;

    #[derive(clap::Parser)]
    struct Command {
        #[command(flatten)]
        light: IndirectLight,
    }

    fn settings(flags: &str) -> anyhow::Result<Option<Indirect>> {
        Command::try_parse_from(["argus"].into_iter().chain(flags.split_whitespace()))?.light.settings()
    }

    #[test]
    fn a_setting_without_its_method_is_refused_by_name() {
        for flags in [
            "--cell-rays 256",
            "--bounces 8",
            "--indirect off --vpls 64",
            "--indirect gather --cell-pixels 2",
        ] {
            let flag = flags.split_whitespace().rev().nth(1).unwrap();
            let error = settings(flags).unwrap_err().to_string();
            assert!(error.starts_with(flag) && error.contains("use --indirect "), "{flags}: {error}");
        }
        assert_eq!(settings("").unwrap(), None);
        assert_eq!(settings("--indirect off").unwrap(), Some(Indirect::Off));
        settings("--indirect paths --path-level 6").unwrap();
        let Some(Indirect::Cells(cells)) = settings("--indirect cells --cell-rays 256 --bounces 8").unwrap()
        else {
            panic!("no cells")
        };
        assert_eq!((cells.rays, cells.paths.bounces), (256, 8));
    }
}
