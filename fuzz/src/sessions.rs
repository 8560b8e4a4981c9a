//! Values that pass through clients of sessions: sealed tickets and receipts, and the messages of a client.

use argus_cluster::untrusted;
use argus_proto::v1;
use argus_proto::v1::session_request::Body;
use bytes::Bytes;
use prost::Message;

use super::messages;

/// Bytes as the body of a ticket, and of a receipt: a client with the key may send anything.
pub fn tickets(bytes: &[u8]) -> Result<(), String> {
    let (ticket, receipt) = (untrusted::ticket(bytes), untrusted::receipt(bytes));
    ticket.or(receipt)
}

/// Valid tickets and receipts.
pub fn tickets_corpus() -> Vec<Vec<u8>> {
    let of = |name: &str| {
        let known = messages::corpus().into_iter();
        known.filter(|(kind, _)| messages::ALL[*kind].0 == name).map(|(_, bytes)| bytes).collect::<Vec<_>>()
    };
    [of("RedirectTicket"), of("Receipt")].concat()
}

/// Requests of a session, each after its length.
pub fn words(bytes: &[u8]) -> Result<(), String> {
    let mut rest = Bytes::copy_from_slice(bytes);
    let mut requests = Vec::new();
    let mut end = Ok(());
    while !rest.is_empty() {
        match v1::SessionRequest::decode_length_delimited(&mut rest) {
            Ok(request) => requests.push(request),
            Err(error) => {
                end = Err(error.to_string());
                break;
            }
        }
    }
    untrusted::session_messages(requests);
    end
}

/// A session with relayed frames, one with redirected frames, and one of a client that answers nothing.
pub fn words_corpus() -> Vec<Vec<u8>> {
    let view = |seq| (seq, Body::View(v1::SessionView { redirectable: true, ..Default::default() }));
    let ack = |seq, receipt| (seq, Body::Ack(v1::SessionAck { receipt }));
    let sealed = v1::Sealed { body: vec![1; 40].into(), seal: vec![2; 32].into() };
    let missed = |seq, serial, unreachable| {
        (seq, Body::Missed(v1::SessionMissed { reason: "a wall".to_owned(), serial, unreachable }))
    };
    let sessions = [
        vec![view(1), ack(1, None), view(2), view(3), ack(2, None), ack(3, None)],
        vec![view(1), ack(1, Some(sealed)), view(2), missed(2, 2, false), missed(2, 3, true), ack(2, None)],
        (1..9).map(view).collect(),
    ];
    let said = |(camera_seq, body)| v1::SessionRequest { camera_seq, body: Some(body) };
    let bytes = |session: Vec<_>| {
        session.into_iter().flat_map(|word| said(word).encode_length_delimited_to_vec()).collect()
    };
    sessions.into_iter().map(bytes).collect()
}
