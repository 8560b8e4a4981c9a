//! Sealed messages: messages between two processes that a client carries and cannot change.
//!
//! A coordinator that redirects a client to a worker gives it a *ticket* for the worker, and the worker gives the
//! client a *receipt* for the coordinator. Both are sealed by a key that the two processes share and the client does
//! not know: a keyed BLAKE3 hash over the kind of the message and its bytes. The key is drawn for one joining of a
//! worker under one leadership. A worker that lost its coordinator accepts tickets until the next assignment brings
//! another key.

use argus_proto::v1::Sealed;
use blake3::{Hash, Hasher};
use prost::Message;
use rand::TryRngCore;
use rand::rngs::OsRng;

/// The key by which a coordinator and one worker seal their messages.
#[derive(Clone, PartialEq, Eq)]
pub struct SealKey([u8; 32]);

impl std::fmt::Debug for SealKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("SealKey(…)")
    }
}

/// Kinds of sealed messages. A message of one kind does not open as another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// [`argus_proto::v1::RedirectTicket`], from a coordinator to a worker.
    RedirectTicket,
    /// [`argus_proto::v1::Receipt`], from a worker to its coordinator.
    Receipt,
}

impl Kind {
    fn name(self) -> &'static [u8] {
        match self {
            Self::RedirectTicket => b"argus.v1.Ticket",
            Self::Receipt => b"argus.v1.Receipt",
        }
    }
}

impl SealKey {
    /// A new random key; `None` if the operating system has no randomness.
    pub fn drawn() -> Option<Self> {
        let mut key = [0; 32];
        OsRng.try_fill_bytes(&mut key).ok()?;
        Some(Self(key))
    }

    /// The key of an assignment; `None` if it has not 32 bytes.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        bytes.try_into().ok().map(Self)
    }

    /// The bytes for an assignment, which travels only within the cluster.
    pub fn to_bytes(&self) -> Vec<u8> {
        self.0.to_vec()
    }

    /// Seals a message.
    pub fn seal(&self, kind: Kind, message: &impl Message) -> Sealed {
        self.seal_bytes(kind, message.encode_to_vec())
    }

    pub(crate) fn seal_bytes(&self, kind: Kind, body: Vec<u8>) -> Sealed {
        let seal = self.hash(kind, &body).as_bytes().to_vec();
        Sealed { body: body.into(), seal: seal.into() }
    }

    /// Opens a message; `None` unless it is of this kind and sealed with this key.
    pub fn open<M: Message + Default>(&self, kind: Kind, sealed: &Sealed) -> Option<M> {
        let seal = Hash::from_bytes(sealed.seal.as_ref().try_into().ok()?);
        // Hashes are compared in constant time.
        if self.hash(kind, &sealed.body) != seal {
            return None;
        }
        M::decode(sealed.body.clone()).ok()
    }

    fn hash(&self, kind: Kind, body: &[u8]) -> Hash {
        let mut hasher = Hasher::new_keyed(&self.0);
        let name = kind.name();
        // The length separates name and body unambiguously.
        hasher.update(&[name.len() as u8]).update(name).update(body);
        hasher.finalize()
    }
}

/// Serial numbers of redeemed tickets, so that each ticket is accepted once. Numbers older than the newest
/// [`RedeemedSerials::SPAN`] count as redeemed.
#[derive(Debug, Clone)]
pub(crate) struct RedeemedSerials {
    newest: u64,
    /// A ring of bits, one for each number.
    bits: Box<[u64]>,
}

impl Default for RedeemedSerials {
    fn default() -> Self {
        Self { newest: 0, bits: vec![0; (Self::SPAN / 64) as usize].into_boxed_slice() }
    }
}

impl RedeemedSerials {
    /// Numbers that are remembered: many more than there are redirects in flight. A client that hoards tickets loses
    /// older ones.
    const SPAN: u64 = 1 << 12;

    /// Records a number; `false` if it was redeemed before or is too old. Numbers start at 1.
    pub(crate) fn first_time(&mut self, serial: u64) -> bool {
        if serial == 0 || serial.saturating_add(Self::SPAN) <= self.newest {
            return false;
        }
        if serial > self.newest {
            if serial - self.newest >= Self::SPAN {
                self.bits.fill(0);
            } else {
                // Clears the bits of older numbers.
                for fresh in self.newest + 1..serial {
                    *self.word(fresh) &= !Self::bit(fresh);
                }
            }
            self.newest = serial;
            *self.word(serial) |= Self::bit(serial);
            return true;
        }
        let (word, bit) = (self.word(serial), Self::bit(serial));
        let fresh = *word & bit == 0;
        *word |= bit;
        fresh
    }

    fn word(&mut self, serial: u64) -> &mut u64 {
        &mut self.bits[(serial % Self::SPAN / 64) as usize]
    }

    fn bit(serial: u64) -> u64 {
        1 << (serial % 64)
    }
}

#[cfg(test)]
mod tests {
    use argus_proto::v1::{Receipt, RedirectTicket};

    use super::*;

    fn key(byte: u8) -> SealKey {
        SealKey([byte; 32])
    }

    #[test]
    fn a_sealed_message_opens_only_with_its_key_and_kind() {
        let ticket = RedirectTicket { serial: 7, ..RedirectTicket::default() };
        let sealed = key(1).seal(Kind::RedirectTicket, &ticket);
        assert_eq!(key(1).open(Kind::RedirectTicket, &sealed), Some(ticket));
        assert_eq!(key(2).open::<RedirectTicket>(Kind::RedirectTicket, &sealed), None);
        assert_eq!(key(1).open::<Receipt>(Kind::Receipt, &sealed), None);
        for broken in [
            Sealed { body: vec![8, 8].into(), ..sealed.clone() },
            Sealed { seal: sealed.seal.slice(1..), ..sealed.clone() },
            Sealed { seal: Default::default(), ..sealed.clone() },
        ] {
            assert_eq!(key(1).open::<RedirectTicket>(Kind::RedirectTicket, &broken), None, "{broken:?}");
        }
        assert_eq!(SealKey::from_bytes(&key(3).to_bytes()), Some(key(3)));
        assert_eq!(SealKey::from_bytes(&[0; 31]), None);
    }

    #[test]
    fn a_key_is_never_printed() {
        assert!(!format!("{:?}", key(0xab)).contains("171"));
    }

    #[test]
    fn each_number_is_accepted_once_in_any_order() {
        let mut redeemed = RedeemedSerials::default();
        for serial in [3, 1, 2, 70, 65, 66] {
            assert!(redeemed.first_time(serial), "{serial}");
        }
        for serial in [0, 1, 2, 3, 65, 66, 70] {
            assert!(!redeemed.first_time(serial), "{serial}");
        }
        // The ring turns: numbers that share a bit with old ones are new, and old ones do not return.
        let far = 70 + RedeemedSerials::SPAN;
        assert!(redeemed.first_time(far));
        assert!(!redeemed.first_time(70) && !redeemed.first_time(far) && !redeemed.first_time(4));
        assert!(redeemed.first_time(far - 1) && redeemed.first_time(71) && !redeemed.first_time(71));
        assert!(
            redeemed.first_time(u64::MAX) && !redeemed.first_time(u64::MAX) && !redeemed.first_time(far + 1)
        );
    }
}
