//! The thin client: connect, request, stream, measure.
