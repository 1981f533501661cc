//! Who may speak to the page's server: Host, Origin and token. Pure functions of what a request says.
//!
//! A page of any other site that the user has open can send requests to loopback, and a name of that site can be made to point there (DNS
//! rebinding). So a request must name this server by an address and not by a foreign name, a browser's request must come from this
//! server's own page, and whoever wants to see or move anything must know the token, which is in the printed address only.
//! What this does not do: encrypt. With `--listen` beyond loopback, whoever can read the network can read the token.

use std::net::{IpAddr, SocketAddr};

/// Random bytes of a token: nobody guesses 128 bits.
const TOKEN_BYTES: usize = 16;

/// What a page must know; another one at every start.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Token(String);

impl Token {
    /// From the operating system's random numbers.
    pub fn draw() -> Token {
        Token(hex(rand::random::<[u8; TOKEN_BYTES]>()))
    }

    /// As it stands in the address, in hexadecimal.
    pub fn text(&self) -> &str {
        &self.0
    }

    /// Whether `offered` is this token, in a time that does not tell how much of it was right.
    pub fn is(&self, offered: &str) -> bool {
        let same_length = self.0.len() == offered.len();
        let different = self.0.bytes().zip(offered.bytes()).fold(0, |different, (a, b)| different | (a ^ b));
        same_length && different == 0
    }
}

fn hex(bytes: [u8; TOKEN_BYTES]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Why a request is refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum Refusal {
    #[error("this server is not called {host:?}: open the address that `hysteron serve` printed")]
    Host { host: String },
    #[error("a page from {origin:?} may not speak to this bench: open the address that `hysteron serve` printed")]
    Origin { origin: String },
    #[error("the token is missing, wrong or of an earlier start: open the address that `hysteron serve` printed last")]
    Token,
}

/// The rules of one server.
#[derive(Clone, Debug)]
pub struct Gate {
    listens_at: SocketAddr,
    /// What a page must know.
    pub token: Token,
}

impl Gate {
    /// For a server that listens at `listens_at`.
    pub fn new(listens_at: SocketAddr, token: Token) -> Gate {
        Gate { listens_at, token }
    }

    /// Checks the Host header: our port, and `localhost` or an address. Only a server that listens beyond loopback takes addresses beyond it.
    ///
    /// # Errors
    /// [`Refusal::Host`].
    pub fn check_host(&self, host: Option<&str>) -> Result<(), Refusal> {
        let refused = || Refusal::Host { host: shortened(host.unwrap_or_default()) };
        let (name, port) = host.and_then(split).ok_or_else(refused)?;
        // A browser leaves the port of http out.
        if port.unwrap_or(80) != self.listens_at.port() {
            return Err(refused());
        }
        let is_ours = match name.parse::<IpAddr>() {
            Ok(address) => address.is_loopback() || !self.listens_at.ip().is_loopback(),
            Err(_) => name.eq_ignore_ascii_case("localhost"),
        };
        if is_ours { Ok(()) } else { Err(refused()) }
    }

    /// Checks the Origin header against the Host: absent only where a browser leaves it out, which it never does for a socket.
    ///
    /// # Errors
    /// [`Refusal::Origin`].
    pub fn check_origin(&self, origin: Option<&str>, host: Option<&str>, is_socket: bool) -> Result<(), Refusal> {
        let is_ours = match (origin, host) {
            (None, _) => !is_socket,
            (Some(origin), Some(host)) => {
                origin.strip_prefix("http://").is_some_and(|from| from.eq_ignore_ascii_case(host))
            }
            (Some(_), None) => false,
        };
        if is_ours { Ok(()) } else { Err(Refusal::Origin { origin: shortened(origin.unwrap_or_default()) }) }
    }

    /// Checks a token.
    ///
    /// # Errors
    /// [`Refusal::Token`].
    pub fn check_token(&self, offered: &str) -> Result<(), Refusal> {
        if self.token.is(offered) { Ok(()) } else { Err(Refusal::Token) }
    }
}

/// Name and port of a Host header; an IPv6 address stands in brackets.
fn split(host: &str) -> Option<(&str, Option<u16>)> {
    let (name, port) = match host.strip_prefix('[') {
        Some(rest) => {
            let (name, after) = rest.split_once(']')?;
            (name, if after.is_empty() { None } else { Some(after.strip_prefix(':')?) })
        }
        None => host.split_once(':').map_or((host, None), |(name, port)| (name, Some(port))),
    };
    let port = port.map(|text| text.parse::<u16>().ok());
    match port {
        Some(None) => None,
        Some(Some(port)) => Some((name, Some(port))),
        None => Some((name, None)),
    }
}

/// What a stranger sent, at a length fit for a message.
fn shortened(text: &str) -> String {
    text.chars().take(80).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gate(at: &str) -> Gate {
        Gate::new(at.parse().unwrap(), Token::draw())
    }

    #[test]
    fn hosts_are_addresses_of_ours_and_never_foreign_names() {
        let loopback = gate("127.0.0.1:7500");
        for host in ["127.0.0.1:7500", "localhost:7500", "LOCALHOST:7500", "[::1]:7500"] {
            assert_eq!(loopback.check_host(Some(host)), Ok(()), "{host}");
        }
        for host in [
            "127.0.0.1",
            "127.0.0.1:7501",
            "192.168.1.5:7500",
            "evil.example:7500",
            "localhost.evil.example:7500",
            "",
            "[::1",
            "[::1]7500",
            "127.0.0.1:x",
            "127.0.0.1:75000",
        ] {
            assert!(loopback.check_host(Some(host)).is_err(), "{host}");
        }
        assert!(loopback.check_host(None).is_err());
        // Widened: any address, as several lead here, but still no name.
        let wide = gate("0.0.0.0:7500");
        assert_eq!(wide.check_host(Some("192.168.1.5:7500")), Ok(()));
        assert!(wide.check_host(Some("evil.example:7500")).is_err());
        // The port that browsers leave out.
        assert_eq!(gate("127.0.0.1:80").check_host(Some("localhost")), Ok(()));
    }

    #[test]
    fn origins_are_this_very_host_and_sockets_must_name_one() {
        let gate = gate("127.0.0.1:7500");
        let host = Some("127.0.0.1:7500");
        assert_eq!(gate.check_origin(Some("http://127.0.0.1:7500"), host, true), Ok(()));
        assert_eq!(gate.check_origin(None, host, false), Ok(()));
        assert!(gate.check_origin(None, host, true).is_err());
        for origin in
            ["null", "http://localhost:7500", "https://127.0.0.1:7500", "http://evil.example", "http://127.0.0.1:75000"]
        {
            assert!(gate.check_origin(Some(origin), host, false).is_err(), "{origin}");
        }
    }

    #[test]
    fn a_token_is_itself_and_nothing_else_and_new_each_time() {
        let gate = gate("127.0.0.1:7500");
        let text = gate.token.text().to_owned();
        assert_eq!((text.len(), gate.check_token(&text)), (32, Ok(())));
        let stale = Token::draw();
        for wrong in
            ["", stale.text(), &text[1..], &format!("{text}0"), &text.to_uppercase().replace(char::is_numeric, "x")]
        {
            assert_eq!(gate.check_token(wrong), Err(Refusal::Token), "{wrong}");
        }
    }

    #[test]
    fn what_a_stranger_sends_is_quoted_short_and_on_one_line() {
        let line = gate("127.0.0.1:7500").check_host(Some(&"a\n".repeat(1000))).unwrap_err().to_string();
        assert!(line.len() < 300 && !line.contains('\n'), "{line}");
    }
}
