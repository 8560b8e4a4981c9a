//! The wire: argus.v1 messages and services, and their conversions to the vocabulary.
