//! Challenges: a server learns that somebody receives at an address before it keeps or sends anything for it.
//!
//! As in the cookie exchange of DTLS (RFC 6347, section 4.2.1), a challenge is a message authentication code of address,
//! session and time, so that the server keeps no state for those who have not answered one.

use crate::host::Network;
use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;
use std::net::{IpAddr, SocketAddr};
use std::time::{Duration, Instant};

/// A challenge is made anew after this time.
const PERIOD: Duration = Duration::from_secs(10);
/// Periods before the present one whose challenges are still taken.
const OLDER_PERIODS: u64 = 2;
/// Longest time for which a challenge begins a session.
pub(super) const LIFETIME: Duration = PERIOD.saturating_mul(OLDER_PERIODS as u32 + 1);
/// Period numbers in a challenge; 0 is none of them, so that no challenge is 0.
const PERIOD_NUMBERS: u64 = 255;

/// Makes and checks the challenges of one server.
#[derive(Debug)]
pub(super) struct Challenges {
    secret: Vec<u8>,
    begun: Instant,
}

impl Challenges {
    /// Draws a secret.
    pub fn new(network: &dyn Network, now: Instant) -> Self {
        let secret = (0..4).flat_map(|_| network.session().to_le_bytes()).collect();
        Self { secret, begun: now }
    }

    /// The present challenge to a session at an address.
    pub fn make(&self, address: SocketAddr, session: u64, now: Instant) -> u64 {
        self.of_period(self.period(now), address, session)
    }

    /// Whether it is a challenge to this session at this address, made no longer than [`LIFETIME`] ago.
    pub fn is_fresh(&self, challenge: u64, address: SocketAddr, session: u64, now: Instant) -> bool {
        let period = self.period(now);
        (period.saturating_sub(OLDER_PERIODS)..=period)
            .filter(|period| number(*period) == challenge & 0xff)
            .any(|period| self.of_period(period, address, session) == challenge)
    }

    fn period(&self, now: Instant) -> u64 {
        now.saturating_duration_since(self.begun).as_secs() / PERIOD.as_secs()
    }

    /// Seven bytes of the code above one byte of the period.
    fn of_period(&self, period: u64, address: SocketAddr, session: u64) -> u64 {
        let Ok(mut mac) = <Hmac<Sha256> as KeyInit>::new_from_slice(&self.secret) else {
            // HMAC takes keys of any length.
            return number(period);
        };
        mac.update(&period.to_le_bytes());
        mac.update(&session.to_le_bytes());
        match address.ip() {
            IpAddr::V4(ip) => mac.update(&ip.octets()),
            IpAddr::V6(ip) => mac.update(&ip.octets()),
        }
        mac.update(&address.port().to_le_bytes());
        let code = mac.finalize().into_bytes();
        let mut bytes = [0; 8];
        bytes[1..].copy_from_slice(&code[..7]);
        u64::from_le_bytes(bytes) | number(period)
    }
}

fn number(period: u64) -> u64 {
    1 + period % PERIOD_NUMBERS
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulated::{SimulatedNetwork, SimulatedOptions};

    #[test]
    fn a_challenge_is_for_one_session_at_one_address_and_for_a_while() {
        let network = SimulatedNetwork::new(SimulatedOptions::default());
        let begun = Instant::now();
        let challenges = Challenges::new(&network, begun);
        let others = Challenges::new(&network, begun);
        let address = |text: &str| text.parse::<SocketAddr>().unwrap();
        let here = address("192.168.1.7:4000");
        for made_s in [0, 9, 10, 2545, 100_000] {
            let at = begun + Duration::from_secs(made_s);
            let challenge = challenges.make(here, 7, at);
            let after = |later: Duration| challenges.is_fresh(challenge, here, 7, at + later);
            assert!(challenge != 0 && after(Duration::ZERO) && after(LIFETIME - PERIOD), "{made_s}");
            assert!(!after(LIFETIME) && !after(PERIOD * PERIOD_NUMBERS as u32), "{made_s}");
            for (other, session) in
                [("192.168.1.7:4001", 7), ("192.168.1.8:4000", 7), ("192.168.1.7:4000", 8)]
            {
                assert!(!challenges.is_fresh(challenge, address(other), session, at), "{other} {session}");
            }
            assert!(!others.is_fresh(challenge, here, 7, at));
            assert!(
                !challenges.is_fresh(challenge ^ 1 << 8, here, 7, at) && !challenges.is_fresh(0, here, 7, at)
            );
        }
    }
}
