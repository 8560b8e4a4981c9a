//! Who does what: balance, membership, sessions, placement, and the processes around them.
