//! One price of time: what each open view is given, and which sources are rendered for all.
//!
//! Every open view takes the offer with the least E + λ·C ([`decide`]). E is the predicted error beyond that of the same view from
//! triangles, in mean FLIP; C is the predicted time, in seconds; λ is the price of time, in FLIP a second ([`TimePrice`]). What views
//! lose because no source stands near their eyes is summed in accounts; the source whose account is worth most for its time is
//! bought ([`buy`]): a worker renders it in slices, between which views run.
//!
//! | file | what it answers |
//! |---|---|
//! | [`decide`] | which offer a view takes, at which worker |
//! | [`buy`] | which account is worth most, and whether it is worth its price |
//! | [`time_price`] | what a second is worth now |
//! | [`prices`] | how long each kind of offer takes at a worker |
//! | [`errors`] | which error each kind of offer has in this scene |
//! | [`source_grid`] | how much of a view a source sees, by the source's own depth |
//! | [`pool`] | which worker holds which source |
//! | [`offer_kind`] | which ways there are |
//!
//! All are pure: the coordinator, the simulator and the tests call the same functions.

pub mod buy;
pub mod decide;
pub mod errors;
pub mod offer_kind;
pub mod pool;
pub mod prices;
pub mod source_grid;
pub mod time_price;

pub use buy::{Accounts, Gain, Purchasable, Site, buy};
pub use decide::{Allowed, Asked, Chosen, Decision, Hand, decide};
pub use errors::{Errors, WarpFeatures};
pub use offer_kind::OfferKind;
pub use pool::{Coming, Pool};
pub use prices::Prices;
pub use source_grid::{Place, Seen, SourceGrid, ViewGrid};
pub use time_price::TimePrice;
