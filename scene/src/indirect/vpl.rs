//! Settings of indirect light by virtual point lights.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::InvalidField;

/// Groups that the VPLs of a scene are divided into, at most.
pub const MOST_VPL_GROUPS: u32 = 256;

/// Source of the VPLs' shadow maps (dual-paraboloid maps of distance).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MapSource {
    /// No maps: VPLs cast no shadows.
    Unshadowed,
    /// A ray through the centre of each texel.
    #[default]
    Exact,
    /// Random surface points, each splatted into one map, with gaps filled from coarser levels (Ritschel et al.,
    /// "Imperfect Shadow Maps for Efficient Computation of Indirect Illumination", 2008).
    Imperfect,
    /// An octree of the scene and one of the VPLs, traversed together. Nearby VPLs share nodes (MegaViews, Kol et al.
    /// 2018).
    MegaViews,
    /// An octree of the scene, traversed for each VPL alone (ManyLoDs, Holländer et al. 2011).
    ManyLods,
}

impl MapSource {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Unshadowed, Self::Exact, Self::Imperfect, Self::MegaViews, Self::ManyLods];

    /// Name in options.
    pub fn name(self) -> &'static str {
        match self {
            Self::Unshadowed => "unshadowed",
            Self::Exact => "exact",
            Self::Imperfect => "imperfect",
            Self::MegaViews => "megaviews",
            Self::ManyLods => "manylods",
        }
    }
}

/// Settings of instant radiosity. `argus-lab study method virtual-lights` measures the cost of each.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct VplSettings {
    /// Number of VPLs. Fewer if lights miss the scene. 0 only with particles.
    pub vpls: u32,
    /// Number of glowing particles: omnidirectional lights that drift with time, gathered like VPLs.
    pub particles: u32,
    /// Most reflections of a path, 1 to 4.
    pub bounces: u32,
    /// Texels on a side of a hemisphere: a power of two, 4 to 256.
    pub map_side: u32,
    /// Source of the maps.
    pub maps: MapSource,
    /// Points splatted into each imperfect map.
    pub points: u32,
    /// Levels of the scene's octree, 1 to 10, for maps from an octree.
    pub levels: u32,
    /// VPLs that a sub-sample of a direct view or a texel of a sample gathers from. Each drawn VPL represents those that
    /// were not drawn.
    pub samples: u32,
    /// Reach of the cross-bilateral filter, sub-samples or texels; 0 for no filter.
    pub filter: u32,
    /// Whether groups of VPLs that cannot light a block of the image are culled before drawing.
    pub cull: bool,
    /// Whether groups of VPLs are drawn by their estimated light for a block, rather than by their number. Unbiased, with
    /// less noise.
    pub weigh: bool,
    /// Mean number of groups, of 256, that a block of the image keeps; 0 keeps all that may light it. Groups are drawn by
    /// their light, and each represents similar groups that were not drawn (Tokuyoshi, Harada: "Stochastic Light
    /// Culling", 2016). Unbiased; adds noise that is common to a block.
    pub groups: u32,
    /// Cut-off distance of VPLs, as a share of the scene's diagonal; 0 for none. Loses energy.
    pub cutoff: f64,
    /// Distance below which a VPL's light does not increase, as a share of the scene's diagonal. Bounds bright spots
    /// around VPLs; loses energy in corners.
    pub clamp: f64,
    /// Shadow bias, in widths of a map's texel at the stored distance.
    pub bias: f64,
    /// Seed of the paths.
    pub seed: u32,
}

impl Default for VplSettings {
    fn default() -> Self {
        Self {
            vpls: 4096,
            particles: 0,
            bounces: 1,
            map_side: 16,
            maps: MapSource::default(),
            points: 1024,
            levels: 8,
            samples: 16,
            filter: 4,
            cull: true,
            weigh: true,
            groups: 0,
            cutoff: 0.0,
            clamp: 0.01,
            bias: 0.5,
            seed: 1,
        }
    }
}

impl fmt::Display for VplSettings {
    /// All fields in short form, for provenance.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            vpls,
            particles,
            bounces,
            map_side,
            maps,
            points,
            levels,
            samples,
            filter,
            cull,
            weigh,
            groups,
            cutoff,
            clamp,
            bias,
            seed,
        } = self;
        write!(f, "{vpls} VPLs of {bounces} bounces, {} maps of {map_side}", maps.name())?;
        if *maps == MapSource::Imperfect {
            write!(f, " from {points} points")?;
        }
        if matches!(maps, MapSource::MegaViews | MapSource::ManyLods) {
            write!(f, " from {levels} levels")?;
        }
        if *groups > 0 {
            write!(f, " in some {groups} groups")?;
        }
        if *particles > 0 {
            write!(f, ", {particles} particles")?;
        }
        write!(
            f,
            ", gather {samples}, filter {filter}, cull {cull} {cutoff}, weigh {weigh}, clamp {clamp}, bias {bias}, seed {seed}"
        )
    }
}

impl VplSettings {
    /// Checks all ranges.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn validate(&self) -> Result<(), InvalidField> {
        let within = InvalidField::within::<u32>;
        within("indirect.vpls", self.vpls, u32::from(self.particles == 0)..=1 << 20)?;
        within("indirect.particles", self.particles, 0..=1 << 20)?;
        within("indirect.bounces", self.bounces, 1..=4)?;
        within("indirect.points", self.points, 1..=1 << 20)?;
        within("indirect.levels", self.levels, 1..=10)?;
        within("indirect.samples", self.samples, 1..=1 << 16)?;
        within("indirect.filter", self.filter, 0..=32)?;
        within("indirect.groups", self.groups, 0..=MOST_VPL_GROUPS)?;
        let from_octree = matches!(self.maps, MapSource::MegaViews | MapSource::ManyLods);
        within("indirect.map_side", self.map_side, if from_octree { 8..=256 } else { 4..=256 })?;
        if !self.map_side.is_power_of_two() {
            let reason = format!("must be a power of two, not {}", self.map_side);
            return Err(InvalidField::new("indirect.map_side", reason));
        }
        InvalidField::within("indirect.cutoff", self.cutoff, 0.0..=1.0)?;
        InvalidField::within("indirect.clamp", self.clamp, 0.0..=1.0)?;
        InvalidField::within("indirect.bias", self.bias, 0.0..=64.0).map(drop)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_out_of_range_is_named() {
        let default = VplSettings::default();
        assert_eq!(default.validate(), Ok(()));
        assert_eq!(VplSettings { vpls: 0, particles: 1, ..default }.validate(), Ok(()));
        let cases = [
            (VplSettings { vpls: 0, ..default }, "indirect.vpls"),
            (VplSettings { particles: (1 << 20) + 1, ..default }, "indirect.particles"),
            (VplSettings { bounces: 5, ..default }, "indirect.bounces"),
            (VplSettings { map_side: 12, ..default }, "indirect.map_side"),
            (VplSettings { map_side: 512, ..default }, "indirect.map_side"),
            (VplSettings { points: 0, ..default }, "indirect.points"),
            (VplSettings { levels: 11, ..default }, "indirect.levels"),
            (VplSettings { samples: 0, ..default }, "indirect.samples"),
            (VplSettings { filter: 33, ..default }, "indirect.filter"),
            (VplSettings { groups: 257, ..default }, "indirect.groups"),
            (VplSettings { cutoff: f64::NAN, ..default }, "indirect.cutoff"),
            (VplSettings { clamp: -0.1, ..default }, "indirect.clamp"),
            (VplSettings { bias: f64::INFINITY, ..default }, "indirect.bias"),
        ];
        for (settings, field) in cases {
            assert_eq!(settings.validate().unwrap_err().field, field);
        }
    }
}
