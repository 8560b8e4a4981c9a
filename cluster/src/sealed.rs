//! What one process says to another through a client.
//!
//! A coordinator that sends a client to a worker gives it a *ticket* to show there, and the worker gives it a *receipt*
//! to bring back. Both are sealed by a key that the two processes share and the client does not know: a keyed BLAKE3
//! hash, over what kind of message it is and its bytes. The key is drawn for one stay of a worker under one
//! leadership; a worker that lost its coordinator takes tickets until the next assignment brings another key.

use argus_proto::v1::Sealed;
use blake3::{Hash, Hasher};
use prost::Message;
use rand::TryRngCore;
use rand::rngs::OsRng;

/// Key by which a coordinator and one worker seal what they send each other.
#[derive(Clone, PartialEq, Eq)]
pub struct SealKey([u8; 32]);

impl std::fmt::Debug for SealKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("SealKey(…)")
    }
}

/// Kinds of sealed messages: one cannot be passed off as another.
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
    /// A new one; `None` where the operating system has no randomness to give.
    pub fn drawn() -> Option<Self> {
        let mut key = [0; 32];
        OsRng.try_fill_bytes(&mut key).ok()?;
        Some(Self(key))
    }

    /// The bytes of an assignment; `None` where they are no key.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        bytes.try_into().ok().map(Self)
    }

    /// For an assignment, which travels within the cluster only.
    pub fn to_bytes(&self) -> Vec<u8> {
        self.0.to_vec()
    }

    /// A message as a client may carry it.
    pub fn seal(&self, kind: Kind, message: &impl Message) -> Sealed {
        self.seal_bytes(kind, message.encode_to_vec())
    }

    pub(crate) fn seal_bytes(&self, kind: Kind, body: Vec<u8>) -> Sealed {
        let seal = self.hash(kind, &body).as_bytes().to_vec();
        Sealed { body: body.into(), seal: seal.into() }
    }

    /// The message, if it is of that kind and the other side sealed it.
    pub fn open<M: Message + Default>(&self, kind: Kind, sealed: &Sealed) -> Option<M> {
        let seal = Hash::from_bytes(sealed.seal.as_ref().try_into().ok()?);
        // Hashes compare in constant time.
        if self.hash(kind, &sealed.body) != seal {
            return None;
        }
        M::decode(sealed.body.clone()).ok()
    }

    fn hash(&self, kind: Kind, body: &[u8]) -> Hash {
        let mut hasher = Hasher::new_keyed(&self.0);
        let name = kind.name();
        // With its length: no name and body can be cut at another place.
        hasher.update(&[name.len() as u8]).update(name).update(body);
        hasher.finalize()
    }
}

/// Serial numbers that were shown, so that each ticket is good once: those of the newest [`RedeemedSerials::SPAN`]; older ones
/// count as shown.
#[derive(Debug, Clone)]
pub(crate) struct RedeemedSerials {
    newest: u64,
    /// A ring of bits.
    bits: Box<[u64]>,
}

impl Default for RedeemedSerials {
    fn default() -> Self {
        Self { newest: 0, bits: vec![0; (Self::SPAN / 64) as usize].into_boxed_slice() }
    }
}

impl RedeemedSerials {
    /// Many more than clients are on their way with. Whoever hoards tickets has no more than these.
    const SPAN: u64 = 1 << 12;

    /// Notes a number; `false` if it was shown before, or is too old to tell. Numbers begin at 1.
    pub(crate) fn first_time(&mut self, serial: u64) -> bool {
        if serial == 0 || serial.saturating_add(Self::SPAN) <= self.newest {
            return false;
        }
        if serial > self.newest {
            if serial - self.newest >= Self::SPAN {
                self.bits.fill(0);
            } else {
                // What the ring now stands for was something else before.
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
    fn what_was_sealed_opens_under_its_key_and_kind_alone() {
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
    fn each_number_is_good_once_in_any_order() {
        let mut redeemed = RedeemedSerials::default();
        for serial in [3, 1, 2, 70, 65, 66] {
            assert!(redeemed.first_time(serial), "{serial}");
        }
        for serial in [0, 1, 2, 3, 65, 66, 70] {
            assert!(!redeemed.first_time(serial), "{serial}");
        }
        // The ring turns: numbers that share a place with old ones are new, and old ones do not come back.
        let far = 70 + RedeemedSerials::SPAN;
        assert!(redeemed.first_time(far));
        assert!(!redeemed.first_time(70) && !redeemed.first_time(far) && !redeemed.first_time(4));
        assert!(redeemed.first_time(far - 1) && redeemed.first_time(71) && !redeemed.first_time(71));
        assert!(redeemed.first_time(u64::MAX) && !redeemed.first_time(u64::MAX) && !redeemed.first_time(far + 1));
    }
}
