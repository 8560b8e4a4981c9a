//! A sampler without the methods of papers.

use argus_sampler::{Indirect, PointSettings, SamplerSettings, VplSettings};
use argus_scene::procedural::mirrors;
use argus_scene::{
    Cancel, MegaViews, ProbeSource, RenderError, SampleJob, SampleSetInfo, Sampler as _, Sampling, ViewJob,
};
use std::sync::Arc;

use crate::common::*;
use crate::reflecting::{probes_from, probes_of};

fn refused<T>(result: Result<T, RenderError>) -> &'static str {
    match result.err() {
        Some(RenderError::Invalid(refused)) => {
            assert!(refused.reason.contains("lacks the feature `papers`"), "{refused}");
            refused.field
        }
        other => panic!("must be refused by field, not {other:?}"),
    }
}

#[test]
fn what_only_a_papers_method_renders_is_refused_by_field_where_it_is_not_plugged_in() {
    let scene = Arc::new(mirrors(3));
    for indirect in [Indirect::Vpl(VplSettings::default()), Indirect::Points(PointSettings::default())] {
        let settings = SamplerSettings { indirect, ..SamplerSettings::default() };
        assert_eq!(
            refused(argus_sampler::GpuSampler::with_settings(gpu(), scene.clone(), settings)),
            "indirect"
        );
    }
    let mut sampler = sampler(&scene);
    let job = job_around_origin(&scene, 16);
    let info = SampleSetInfo { sampling: Sampling::MegaViews(MegaViews::default()), ..(*job.info).clone() };
    let job = specified(&sampler, &SampleJob { info: Arc::new(info), ..job });
    assert_eq!(refused(sampler.render_samples(&job, &Cancel::new()).remove(0)), "sampling");
    for source in [ProbeSource::Octree { levels: 5 }, ProbeSource::POINTS] {
        let reflections = probes_from(&scene, source);
        let job = specified(&sampler, &probes_of(&scene, reflections));
        assert_eq!(refused(sampler.render_samples(&job, &Cancel::new()).remove(0)), "reflections");
        let view = ViewJob { reflections, ..view_job(scene.cameras[0].camera, [16, 12], 1) };
        assert_eq!(refused(sampler.render_views(&[view], &Cancel::new()).remove(0)), "reflections");
    }
}
