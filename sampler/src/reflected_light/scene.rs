//! A scene at a pose, prepared to find what its surfaces reflect. Reflection probes and direct views share it.

use std::sync::Arc;

use argus_gpu::Gpu;
use argus_scene::{ProbeSource, RenderError, Scene};

use super::point_method::{NewPoints, PointMethod};
use super::rays::ReflectionRays;
use crate::packets::PacketTracer;
use crate::settings::missing;

/// A scene, and whether it is at the sampler's present pose.
pub(crate) struct ReflectedScene {
    pub(crate) found_by: ReflectionSource,
    is_posed: bool,
}

/// How reflections are found.
pub(crate) enum ReflectionSource {
    Rays(Box<ReflectionRays>),
    Points(Arc<dyn PointMethod>),
}

impl ReflectedScene {
    /// Prepares a scene for a source, which may be points that are plugged in, at the pose of a packet tracer: a time in seconds. `before` is what was prepared before,
    /// of which trees are kept.
    ///
    /// # Errors
    /// [`RenderError::OutOfMemory`] for a scene of too many triangles, [`RenderError::Invalid`] for points that are not plugged in.
    pub(crate) fn posed(
        before: Option<Self>,
        source: ProbeSource,
        (points, gpu): (Option<&NewPoints>, &Arc<Gpu>),
        scene: &Arc<Scene>,
        tracer: &PacketTracer,
        time_secs: f64,
    ) -> Result<Self, RenderError> {
        let by_points = matches!(source, ProbeSource::Points { .. });
        let found_by = match before {
            _ if by_points => {
                let new = points.ok_or_else(|| missing("reflections", source.name()))?;
                ReflectionSource::Points(new(gpu, scene, time_secs))
            }
            Some(Self { found_by: ReflectionSource::Rays(mut rays), .. }) => {
                rays.pose(scene, tracer, time_secs)?;
                ReflectionSource::Rays(rays)
            }
            _ => ReflectionSource::Rays(Box::new(ReflectionRays::of_tracer(scene, time_secs, tracer)?)),
        };
        Ok(Self { found_by, is_posed: true })
    }

    /// Whether it is prepared for a source at the present pose.
    pub(crate) fn is_ready(&self, source: ProbeSource) -> bool {
        let by_points = matches!(self.found_by, ReflectionSource::Points(_));
        self.is_posed && by_points == matches!(source, ProbeSource::Points { .. })
    }

    /// Marks the pose as out of date.
    pub(crate) fn forget_pose(&mut self) {
        self.is_posed = false;
    }
}
