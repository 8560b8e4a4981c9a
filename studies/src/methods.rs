//! The methods of samplers that studies measure: all that there are.

use argus_sampler::plug::Methods;

/// The methods of the papers.
pub(crate) fn methods() -> Methods {
    let mut methods = Methods::default();
    argus_megaviews::add_to(&mut methods);
    argus_virtual_lights::add_to(&mut methods);
    argus_eye_points::add_to(&mut methods);
    methods
}
