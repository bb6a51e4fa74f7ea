//! The server with real clients: what they are told, who may do what, and what hostile and slow ones come to.

#![allow(clippy::unwrap_used, reason = "a test may end where it finds something wrong")]
#![allow(clippy::disallowed_types, reason = "connects to a server on this machine")]

mod hostile;
mod peer;
mod told;
