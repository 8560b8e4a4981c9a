//! The passes, one file each.

mod adopt_maps;
mod choose_receivers;
mod cull_vpls;
mod filter_indirect;
mod gather;
mod imperfect;
mod receive;
mod spread;

pub(crate) use adopt_maps::AdoptMaps;
pub(crate) use choose_receivers::{BlockUniform, ChooseReceivers, OF_BLOCK};
pub(crate) use cull_vpls::CullVpls;
pub(crate) use filter_indirect::FilterIndirect;
pub(crate) use gather::{Gather, Gathered, IndirectScratch, Maps, blocks};
pub(crate) use imperfect::Imperfect;
pub(crate) use receive::{Batch, Receive};
pub(crate) use spread::{Spread, SpreadFrom};
