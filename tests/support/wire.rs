//! Requests over plain gRPC, so that a test can send what our own client never sends.

use argus_proto::chunks::{FrameAssembler, FrameMeta};
use argus_proto::v1::views_client::ViewsClient;
use argus_proto::{Description, v1};
use argus_scene::{Camera, Frame, Limits, Output, Outputs, PlanRequest, View};
use tonic::Status;
use tonic::transport::Channel;

/// A connection to a service.
pub(crate) struct Wire {
    views: ViewsClient<Channel>,
}

impl Wire {
    pub(crate) async fn connect(url: &str) -> Self {
        let channel = Channel::from_shared(url.to_owned()).unwrap().connect().await.unwrap();
        Self { views: ViewsClient::new(channel) }
    }

    pub(crate) async fn describe(&mut self) -> Description {
        let request = v1::DescribeRequest { protocol_version: argus_proto::PROTOCOL_VERSION };
        self.views.describe(request).await.unwrap().into_inner().try_into().unwrap()
    }

    /// The complete answer to one view.
    pub(crate) async fn render(&mut self, view: v1::View) -> Result<(Frame, FrameMeta), Status> {
        let request =
            v1::RenderRequest { view_id: "a test's view".into(), view: Some(view), ..Default::default() };
        let mut chunks = self.views.render(request).await?.into_inner();
        let mut assembler = FrameAssembler::new(Limits::default());
        while let Some(chunk) = chunks.message().await? {
            if let Some(frame) = assembler.push(chunk).unwrap() {
                return Ok(frame);
            }
        }
        panic!("the stream ended before the frame was whole")
    }
}

/// A small view with every output.
pub(crate) fn small_view(camera: Camera) -> View {
    View {
        camera,
        width: 96,
        height: 72,
        outputs: Outputs::COLOR.with(Output::Range).with(Output::Mask).with(Output::Source),
        plan: PlanRequest::from_samples(),
        pin: None,
        flow_to: None,
        rays: None,
    }
}
