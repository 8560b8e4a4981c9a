//! References of views that were answered.

use argus_scene::{Camera, Frame, Outputs, Plan, PlanRequest, Provenance, SceneState, View};

/// A direct view of `side`² samples per pixel, of the size of `like`, that shows this state.
pub fn direct_view(like: &Frame, camera: Camera, state: SceneState, side: u32) -> View {
    let plan = PlanRequest { direct: true, supersampling: Some(side), ..PlanRequest::default() };
    let pin = Some(Provenance {
        state,
        plan: Plan::direct(side * side),
        // Any device.
        device: String::new(),
        history: false,
        ..like.provenance.clone()
    });
    View {
        camera,
        width: like.width,
        height: like.height,
        outputs: Outputs::COLOR,
        plan,
        pin,
        flow_to: None,
        rays: None,
    }
}
