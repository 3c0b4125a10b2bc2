//! The secret that browsers on other machines need.
//!
//! It is part of the URL that `gerono view` prints, and from then on a cookie that scripts and other sites cannot use.
//! It is new at every start.

use std::fs::File;
use std::io::{self, Read};

use shared_types::sample::hex;

use crate::http::{Refusal, Request};

/// Length of a token, bytes.
const BYTES: usize = 16;

/// Name of the token in the query.
const IN_QUERY: &str = "t";

/// The request has no token, or a wrong one.
const NO_TOKEN: Refusal = Refusal {
    status: 401,
    reason: "this needs the whole address that `gerono view` printed, with what follows `?t=`",
};

/// Token of a server.
#[derive(Clone)]
pub struct Token {
    text: String,
    /// Name of the cookie. Browsers share cookies between the ports of a host, so it contains the port.
    cookie: String,
}

/// Keeps the token out of debug output.
impl std::fmt::Debug for Token {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Token")
    }
}

impl Token {
    /// Draws the token of a server at a port.
    ///
    /// # Errors
    /// If /dev/urandom cannot be read.
    pub fn draw(port: u16) -> io::Result<Self> {
        let mut bytes = [0; BYTES];
        File::open("/dev/urandom")?.read_exact(&mut bytes)?;
        Ok(Self::new(&bytes, port))
    }

    /// Returns the token of these bytes.
    #[must_use]
    pub fn new(bytes: &[u8; BYTES], port: u16) -> Self {
        Self {
            text: hex(bytes),
            cookie: format!("gerono_{port}"),
        }
    }

    /// Returns the query of the URL.
    #[must_use]
    pub fn query(&self) -> String {
        format!("?{IN_QUERY}={}", self.text)
    }

    /// Checks that a request has the token. If it came in the query, returns the header that sets the cookie.
    ///
    /// # Errors
    /// A refusal if it has not.
    pub fn check(&self, request: &Request) -> Result<Option<String>, Refusal> {
        let given = request.query.split('&').filter_map(|pair| pair.split_once('='));
        for (name, value) in given {
            if name == IN_QUERY && self.is(value) {
                return Ok(Some(format!(
                    "{}={}; Path=/; HttpOnly; SameSite=Strict",
                    self.cookie, self.text
                )));
            }
        }
        let cookies = request.cookie.as_deref().unwrap_or_default().split(';');
        let mut values = cookies.filter_map(|cookie| cookie.trim().split_once('='));
        if values.any(|(name, value)| name == self.cookie && self.is(value)) {
            return Ok(None);
        }
        Err(NO_TOKEN)
    }

    /// Compares a text with the token in constant time.
    fn is(&self, text: &str) -> bool {
        let differing =
            |difference, (ours, theirs): (u8, u8)| std::hint::black_box(difference | (ours ^ theirs));
        let pairs = self.text.bytes().zip(text.bytes());
        text.len() == self.text.len() && pairs.fold(0, differing) == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn token() -> Token {
        Token::new(&[0xab; BYTES], 8421)
    }

    fn with(query: &str, cookie: Option<&str>) -> Result<Option<String>, Refusal> {
        token().check(&Request {
            query: query.to_owned(),
            cookie: cookie.map(str::to_owned),
            ..Request::default()
        })
    }

    #[test]
    fn the_address_is_good_for_a_cookie_and_the_cookie_for_everything() {
        let secret = "ab".repeat(BYTES);
        let cookie = with(&format!("t={secret}"), None).unwrap().unwrap();
        assert_eq!(
            cookie,
            format!("gerono_8421={secret}; Path=/; HttpOnly; SameSite=Strict")
        );
        assert_eq!(token().query(), format!("?t={secret}"));
        let pair = cookie.split(';').next().unwrap();
        for cookies in [
            pair.to_owned(),
            format!("a=b; {pair}; c"),
            format!("gerono_8421=x;{pair}"),
        ] {
            assert_eq!(with("", Some(&cookies)), Ok(None), "{cookies}");
        }
    }

    #[test]
    fn what_is_not_the_token_is_refused() {
        let secret = "ab".repeat(BYTES);
        for query in [
            "",
            "t",
            "t=",
            "t=ab",
            &format!("x={secret}"),
            &format!("t={secret}a"),
            &format!("t={}", &secret[1..]),
        ] {
            assert_eq!(with(query, None), Err(NO_TOKEN), "{query}");
        }
        for place in 0..secret.len() {
            let mut wrong = secret.clone();
            wrong.replace_range(place..=place, "c");
            assert_eq!(with(&format!("t={wrong}"), None), Err(NO_TOKEN), "{place}");
        }
        for cookie in [
            format!("gerono_8422={secret}"),
            format!("xgerono_8421={secret}"),
            secret.clone(),
        ] {
            assert_eq!(with("", Some(&cookie)), Err(NO_TOKEN), "{cookie}");
        }
    }

    #[test]
    fn two_servers_have_different_tokens() {
        let [one, other] = [(); 2].map(|()| Token::draw(1).unwrap());
        assert_ne!(one.query(), other.query());
        assert_eq!(format!("{one:?}"), "Token", "it is not printed by chance");
    }
}
