//! The methods of papers that this build has: the only place of the product that names their crates.

use argus_sampler::plug::Methods;

/// Methods for a sampler, beside its own.
#[cfg(feature = "papers")]
pub(crate) fn methods() -> Methods {
    let mut methods = Methods::default();
    argus_megaviews::add_to(&mut methods);
    argus_virtual_lights::add_to(&mut methods);
    argus_eye_points::add_to(&mut methods);
    methods
}

/// Methods for a sampler, beside its own: this build has none.
#[cfg(not(feature = "papers"))]
pub(crate) fn methods() -> Methods {
    Methods::default()
}
