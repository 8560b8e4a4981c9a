//! Traces one ray: through the tree over placed objects, then through the trees of those that it meets.

use glam::Vec3;

use super::rays::LightRaysAbout;
use super::triangles::{AnyTriangle, NearestTriangle, RayHit};
use super::walk::{Leaves, Slabs, walk};
use crate::packets::lanes::{Lanes, Plain};

impl LightRaysAbout<'_> {
    /// Whether anything is hit at 0 < t < `most`, in units of the direction. `origin` is relative to the eye. Rays pass
    /// through transparent parts of cut-outs. False for a ray that is not finite or has no direction.
    pub(crate) fn is_blocked(&self, origin: Vec3, direction: Vec3, most: f32) -> bool {
        if !is_ray(origin, direction, most) {
            return false;
        }
        self.tell(origin, direction, most);
        #[cfg(target_arch = "x86_64")]
        {
            use crate::packets::lanes::avx2::Avx2;

            #[target_feature(enable = "avx2")]
            fn with_avx2(about: &LightRaysAbout<'_>, origin: Vec3, direction: Vec3, most: f32) -> bool {
                about.is_blocked_by::<Avx2>(origin, direction, most)
            }
            if self.rays.has_avx2 {
                // SAFETY: the processor has what the function is compiled for.
                return unsafe { with_avx2(self, origin, direction, most) };
            }
        }
        self.is_blocked_by::<Plain>(origin, direction, most)
    }

    /// The share of light that passes a ray at 0 < t < `most`, in units of the direction. `origin` is relative to the eye. Rays
    /// pass through transparent parts of cut-outs, and in part through transparent surfaces. 1 for a ray that is not finite
    /// or has no direction.
    pub(crate) fn passed(&self, origin: Vec3, direction: Vec3, most: f32) -> f32 {
        if !self.rays.cutouts.has_transparent {
            return f32::from(u8::from(!self.is_blocked(origin, direction, most)));
        }
        if !is_ray(origin, direction, most) {
            return 1.0;
        }
        self.tell(origin, direction, most);
        #[cfg(target_arch = "x86_64")]
        {
            use crate::packets::lanes::avx2::Avx2;

            #[target_feature(enable = "avx2")]
            fn with_avx2(about: &LightRaysAbout<'_>, origin: Vec3, direction: Vec3, most: f32) -> f32 {
                about.passed_by::<Avx2>(origin, direction, most)
            }
            if self.rays.has_avx2 {
                // SAFETY: the processor has what the function is compiled for.
                return unsafe { with_avx2(self, origin, direction, most) };
            }
        }
        self.passed_by::<Plain>(origin, direction, most)
    }

    /// The nearest hit at 0 < t < `most`, in units of the direction. `origin` is relative to the eye. Rays pass through
    /// transparent parts of cut-outs, and meet transparent surfaces as often as their alpha says. `None` for a ray that is not finite or has no direction.
    pub(crate) fn nearest(&self, origin: Vec3, direction: Vec3, most: f32) -> Option<RayHit> {
        if !is_ray(origin, direction, most) {
            return None;
        }
        let hit = self.nearest_of(origin, direction, most);
        self.tell(origin, direction, hit.map_or(most, |hit| hit.t));
        hit
    }

    fn nearest_of(&self, origin: Vec3, direction: Vec3, most: f32) -> Option<RayHit> {
        #[cfg(target_arch = "x86_64")]
        {
            use crate::packets::lanes::avx2::Avx2;

            #[target_feature(enable = "avx2")]
            fn with_avx2(
                about: &LightRaysAbout<'_>,
                origin: Vec3,
                direction: Vec3,
                most: f32,
            ) -> Option<RayHit> {
                about.nearest_by::<Avx2>(origin, direction, most)
            }
            if self.rays.has_avx2 {
                // SAFETY: the processor has what the function is compiled for.
                return unsafe { with_avx2(self, origin, direction, most) };
            }
        }
        self.nearest_by::<Plain>(origin, direction, most)
    }

    fn tell(&self, origin: Vec3, direction: Vec3, most: f32) {
        if let Some(watch) = self.watch {
            watch.cast(origin, direction, most);
        }
    }

    #[inline(always)]
    pub(super) fn is_blocked_by<L: Lanes>(&self, origin: Vec3, direction: Vec3, most: f32) -> bool {
        let lanes = std::marker::PhantomData::<L>;
        self.any_by(&mut AnyObject { about: self, origin, direction, passed: None, lanes }, most)
    }

    #[inline(always)]
    fn passed_by<L: Lanes>(&self, origin: Vec3, direction: Vec3, most: f32) -> f32 {
        let lanes = std::marker::PhantomData::<L>;
        let mut objects = AnyObject { about: self, origin, direction, passed: Some(1.0), lanes };
        if self.any_by(&mut objects, most) { 0.0 } else { objects.passed.unwrap_or(1.0) }
    }

    /// Whether a ray is blocked.
    #[inline(always)]
    fn any_by<L: Lanes>(&self, objects: &mut AnyObject<'_, L>, most: f32) -> bool {
        if self.objects.len() == 1 {
            return objects.visit(0, most) < 0.0;
        }
        if self.objects.is_empty() {
            return false;
        }
        let slabs = Slabs::<L>::new(objects.origin, objects.direction, self.around);
        walk::<L, false>(&self.top, self.rays.top_root, &slabs, most, objects) < 0.0
    }

    #[inline(always)]
    pub(super) fn nearest_by<L: Lanes>(&self, origin: Vec3, direction: Vec3, most: f32) -> Option<RayHit> {
        let lanes = std::marker::PhantomData::<L>;
        let mut objects = NearestObject { about: self, origin, direction, nearest: None, lanes };
        if self.objects.len() == 1 {
            objects.visit(0, most);
        } else if !self.objects.is_empty() {
            let slabs = Slabs::<L>::new(origin, direction, self.around);
            walk::<L, true>(&self.top, self.rays.top_root, &slabs, most, &mut objects);
        }
        objects.nearest
    }
}

/// NaN fails.
#[inline(always)]
fn is_ray(origin: Vec3, direction: Vec3, most: f32) -> bool {
    origin.is_finite() && direction.is_finite() && direction != Vec3::ZERO && most > 0.0
}

/// Placed objects, until one blocks a ray.
struct AnyObject<'a, L> {
    about: &'a LightRaysAbout<'a>,
    origin: Vec3,
    direction: Vec3,
    /// The share of light that passes transparent surfaces; `None` if the caller asks only whether something blocks the ray.
    passed: Option<f32>,
    lanes: std::marker::PhantomData<L>,
}

impl<L: Lanes> Leaves for AnyObject<'_, L> {
    #[inline(always)]
    fn visit(&mut self, leaf: u32, limit: f32) -> f32 {
        let Some((object, slabs, ray)) = self.about.enter::<L>(leaf, self.origin, self.direction) else {
            return limit;
        };
        let rays = self.about.rays;
        let instance = object.instance;
        let mut triangles = AnyTriangle { rays, ray, instance, passed: self.passed, lanes: self.lanes };
        let limit = walk::<L, false>(&rays.trees.nodes, object.root.reference, &slabs, limit, &mut triangles);
        self.passed = triangles.passed;
        limit
    }
}

/// Placed objects, for the nearest hit.
struct NearestObject<'a, L> {
    about: &'a LightRaysAbout<'a>,
    origin: Vec3,
    direction: Vec3,
    nearest: Option<RayHit>,
    lanes: std::marker::PhantomData<L>,
}

impl<L: Lanes> Leaves for NearestObject<'_, L> {
    #[inline(always)]
    fn visit(&mut self, leaf: u32, limit: f32) -> f32 {
        let Some((object, slabs, ray)) = self.about.enter::<L>(leaf, self.origin, self.direction) else {
            return limit;
        };
        let rays = self.about.rays;
        let (instance, nearest) = (object.instance, self.nearest);
        let mut triangles = NearestTriangle { rays, ray, instance, nearest, lanes: self.lanes };
        let limit = walk::<L, true>(&rays.trees.nodes, object.root.reference, &slabs, limit, &mut triangles);
        self.nearest = triangles.nearest;
        limit
    }
}
