//! Pages of light cells that the sampler lacks are taken from other workers, which have filled them.
//!
//! The coordinator names workers that hold cells. A page that none of them sends soon is filled here: so a worker that is killed
//! costs the time of a request.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use argus_proto::v1::samples_client::SamplesClient;
use argus_proto::{Fault, v1};
use argus_scene::{CellContent, CellPage, CellPages, InvalidField};
use bytes::Bytes;
use futures::Stream;
use futures::StreamExt;
use tonic::Status;
use tracing::warn;

use super::node::{ActiveRequest, Node};
use crate::rate_limited_log::RateLimitedLog;

/// Pause between two looks at what the sampler lacks.
const PAUSE: Duration = Duration::from_millis(50);
/// Most pages of a request.
const MOST_PAGES: usize = 1024;
/// Pages that are packed at once, while no view looks cells up.
const PACKED_AT_ONCE: usize = 32;
/// Workers that are asked for a page, one after the other.
const MOST_ASKED: usize = 2;
/// How long a worker may send nothing.
const SILENCE: Duration = Duration::from_secs(2);

/// Takes pages that the sampler lacks from other workers, as long as it is polled.
pub(super) async fn take(node: &Arc<Node>) {
    loop {
        tokio::time::sleep(PAUSE).await;
        let holders = node.cell_holders.borrow().clone();
        let Some(pages) = node.health.cell_pages().filter(|_| !holders.is_empty()) else { continue };
        let wanted = off_thread({
            let pages = pages.clone();
            move || Some((pages.content()?, pages.wanted(MOST_PAGES)))
        });
        let Some(Some((content, mut lacking))) = wanted.await else { continue };
        for address in holders.iter().filter(|address| **address != node.hello.address).take(MOST_ASKED) {
            if lacking.is_empty() {
                break;
            }
            let answer = received(node, &pages, content, &mut lacking, address);
            if let Err(fault) = node.unless_suspected(address, answer).await {
                static MISSED: RateLimitedLog = RateLimitedLog::new();
                if let Some(left_out) = MISSED.now() {
                    warn!(address, %fault, left_out, "a worker did not send its light cells");
                }
            }
        }
        off_thread(move || pages.give_up(&lacking)).await;
    }
}

/// Runs what takes a lock of the render thread. `None` if it panics.
async fn off_thread<T: Send + 'static>(run: impl FnOnce() -> T + Send + 'static) -> Option<T> {
    tokio::task::spawn_blocking(run).await.ok()
}

/// Asks a worker for pages, and adds those that it sends. They are no longer lacking.
async fn received(
    node: &Node,
    pages: &Arc<dyn CellPages>,
    content: CellContent,
    lacking: &mut Vec<CellPage>,
    address: &str,
) -> Result<(), Fault> {
    let mut client = SamplesClient::new(node.channels.to(address)?);
    let request = v1::CellsRequest { content: Bytes::copy_from_slice(&content), pages: lacking.clone() };
    let unavailable = |status: Status| Fault::Unavailable(status.message().to_owned());
    let silent = |_| Fault::Unavailable(format!("{address} sent nothing for {} s", SILENCE.as_secs()));
    let answer = tokio::time::timeout(SILENCE, client.cells(request)).await.map_err(silent)?;
    let mut answer = answer.map_err(unavailable)?.into_inner();
    let mut asked: BTreeSet<CellPage> = lacking.iter().copied().collect();
    while let Some(sent) =
        tokio::time::timeout(SILENCE, answer.message()).await.map_err(silent)?.map_err(unavailable)?
    {
        check(&sent, &mut asked)?;
        let (pages, page) = (pages.clone(), sent.page);
        let added = off_thread(move || pages.add(content, page, &sent.packed)).await;
        added.ok_or_else(|| Fault::Unavailable("light cells cannot be added".to_owned()))??;
        lacking.retain(|lacks| *lacks != page);
    }
    Ok(())
}

/// Rejects a page that was not asked for, or came before, and bytes that changed on the way. `asked` are the pages still to come.
fn check(sent: &v1::CellsPage, asked: &mut BTreeSet<CellPage>) -> Result<(), InvalidField> {
    if !asked.remove(&sent.page) {
        return Err(InvalidField::new("page", "was not asked for"));
    }
    if blake3::hash(&sent.packed).as_bytes()[..] != sent.hash[..] {
        return Err(InvalidField::new("packed", "does not have its hash"));
    }
    Ok(())
}

/// A page as it is sent.
fn page(page: CellPage, packed: Bytes) -> v1::CellsPage {
    let hash = Bytes::copy_from_slice(blake3::hash(&packed).as_bytes());
    v1::CellsPage { page, packed, hash }
}

/// The pages that this worker holds of those that are asked for.
///
/// # Errors
/// The invalid field, or [`Fault::NotFound`] without light cells.
pub(super) fn sent(
    node: &Node,
    active: ActiveRequest,
    request: v1::CellsRequest,
) -> Result<impl Stream<Item = Result<v1::CellsPage, Status>> + Send + use<>, Fault> {
    let content = CellContent::try_from(&request.content[..])
        .map_err(|_| InvalidField::new("content", "must have 32 bytes"))?;
    InvalidField::within("pages", request.pages.len(), 1..=MOST_PAGES)?;
    let held = node.health.cell_pages();
    let held = held.ok_or_else(|| Fault::NotFound("this worker has no light cells".to_owned()))?;
    let some: Vec<Vec<CellPage>> = request.pages.chunks(PACKED_AT_ONCE).map(<[CellPage]>::to_vec).collect();
    let pack = move |some: Vec<CellPage>| {
        let held = held.clone();
        async move { off_thread(move || held.packed(content, &some)).await.unwrap_or_default() }
    };
    let pages = futures::stream::iter(some).then(pack).flat_map(futures::stream::iter);
    Ok(pages.map(move |(number, packed)| {
        let _active_until_sent = &active;
        Ok(page(number, packed))
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_taken_once_if_it_was_asked_for_and_has_its_hash() {
        let good = page(3, Bytes::from_static(b"cells"));
        let mut asked = BTreeSet::from([3, 4]);
        assert_eq!(check(&good, &mut asked), Ok(()));
        let field =
            |sent: &v1::CellsPage, asked: &mut BTreeSet<CellPage>| check(sent, asked).unwrap_err().field;
        assert_eq!(field(&good, &mut asked), "page", "it came before");
        assert_eq!(field(&page(9, Bytes::new()), &mut asked), "page");
        let changed = v1::CellsPage { packed: Bytes::from_static(b"bells"), page: 4, ..good };
        assert_eq!(field(&changed, &mut asked), "packed");
    }
}
