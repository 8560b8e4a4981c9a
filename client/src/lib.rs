//! The thin client: connect, request, stream, measure.
//!
//! [`Client`] renders single views and batches and reports status. [`Session`] follows a moving camera. [`load`] is an
//! open-loop load generator. The crate links neither a GPU nor scene loaders.
//!
//! ```no_run
//! # async fn example() -> Result<(), argus_client::ClientError> {
//! use argus_client::{Client, RenderOptions};
//! use argus_scene::{Outputs, PlanRequest, View};
//!
//! let client = Client::connect("http://127.0.0.1:7400").await?;
//! let camera = client.description().cameras[0].camera;
//! let (outputs, plan) = (Outputs::COLOR, PlanRequest::default());
//! let view = View { camera, width: 640, height: 480, outputs, plan, pin: None, flow_to: None, rays: None };
//! let answer = client.render(&view, &RenderOptions::default()).await?;
//! println!("{} made it in {:?}", answer.meta.worker, answer.latency);
//! # Ok(())
//! # }
//! ```

mod arrival;
mod batch;
mod connect;
mod credentials;
mod error;
mod health;
pub mod load;
mod outbox;
mod redirect;
mod render;
mod retry;
mod session;
mod transforms;
mod unanswered;

pub use argus_proto::Description;
pub use argus_proto::chunks::FrameMeta;
pub use argus_proto::network::Network;
pub use argus_proto::v1::{Encoding, LightCells, StatusResponse as ClusterStatus, WorkerStatus};
pub use batch::{Batch, BatchAnswer};
pub use connect::{Client, ConnectOptions};
pub use credentials::{Credentials, Key, Token};
pub use error::ClientError;
pub use health::{Health, health};
pub use render::{Answer, RenderOptions};
pub use session::{Session, SessionEvent, SessionOptions};
pub use transforms::{MOST_NODES, Moved, Node, NodeSetter, SetTransform, Space};
