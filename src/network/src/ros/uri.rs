//! URIs of masters and nodes: `http://host:port/`.

use super::RosError;
use std::fmt;
use std::net::IpAddr;
use std::str::FromStr;

/// Default URI of the master.
const DEFAULT_MASTER: &str = "http://127.0.0.1:11311";

/// A host and a port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HostPort {
    /// A name or an IP address, one of version 6 without its brackets.
    pub host: String,
    /// TCP port.
    pub port: u16,
}

impl HostPort {
    /// Parses a URI of a master or a node.
    pub fn of_uri(uri: &str) -> Option<Self> {
        let place = uri.strip_prefix("http://")?.trim_end_matches('/');
        let (host, port) = place.rsplit_once(':')?;
        let port = port.parse().ok().filter(|port| *port > 0)?;
        let host = host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).unwrap_or(host);
        let is_host =
            |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '-' | '_' | ':' | '%') || !c.is_ascii();
        let is_one = !host.is_empty() && host.len() < 256 && host.chars().all(is_host);
        is_one.then(|| Self { host: host.to_owned(), port })
    }
}

impl fmt::Display for HostPort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { host, port } = self;
        if host.contains(':') { write!(f, "[{host}]:{port}") } else { write!(f, "{host}:{port}") }
    }
}

/// An address of this machine that a node listens on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BindAddress(pub IpAddr);

impl FromStr for BindAddress {
    type Err = RosError;

    fn from_str(text: &str) -> Result<Self, RosError> {
        let why = || "write an IP address of this machine, or 0.0.0.0 for all of them".to_owned();
        let wrong = |_| RosError::Host { host: text.to_owned(), why: why() };
        text.parse().map(Self).map_err(wrong)
    }
}

/// Address of a ROS master.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MasterUri {
    /// The URI as it was given.
    pub uri: String,
    /// Host and port of the Master API.
    pub place: HostPort,
}

impl MasterUri {
    /// The URI in `ROS_MASTER_URI`, or the default one.
    ///
    /// # Errors
    /// When the variable has no valid URI.
    pub fn from_environment() -> Result<Self, RosError> {
        let named = std::env::var("ROS_MASTER_URI").ok().filter(|uri| !uri.is_empty());
        named.as_deref().unwrap_or(DEFAULT_MASTER).parse()
    }
}

impl FromStr for MasterUri {
    type Err = RosError;

    fn from_str(text: &str) -> Result<Self, RosError> {
        let place = HostPort::of_uri(text).ok_or_else(|| RosError::MasterUri { uri: text.to_owned() })?;
        Ok(Self { uri: text.to_owned(), place })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_master_is_told_by_host_and_port() {
        for (good, told) in [
            ("http://127.0.0.1:11311", "127.0.0.1:11311"),
            ("http://lab-pc:11311/", "lab-pc:11311"),
            ("http://[::1]:11311", "[::1]:11311"),
        ] {
            assert_eq!(good.parse::<MasterUri>().unwrap().place.to_string(), told);
        }
        for wrong in ["", "127.0.0.1:11311", "http://lab-pc", "http://:11311", "http://lab:0", "http://a/b:1"]
        {
            let told = wrong.parse::<MasterUri>().unwrap_err().to_string();
            assert!(told.contains("write it as http://127.0.0.1:11311"), "{told}");
        }
    }
}
