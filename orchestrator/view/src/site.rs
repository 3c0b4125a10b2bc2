//! Access control: every request is checked here before it is answered.

use crate::foxglove::PROTOCOLS;
use crate::host_name::HostNames;
use crate::http::{NOT_FOUND, Refusal, Request, Upgrade};
use crate::token::Token;

const OTHER_SITE: Refusal = Refusal {
    status: 403,
    reason: "pages of other sites may not connect",
};

const OTHER_PROTOCOL: Refusal = Refusal {
    status: 400,
    reason: "this WebSocket supports `foxglove.sdk.v1` and `foxglove.websocket.v1`",
};

/// Access rules of a server.
#[derive(Clone, Debug)]
pub struct Site {
    /// Host names of the server.
    pub names: HostNames,
    /// Required token; `None` if only this machine reaches the server.
    pub token: Option<Token>,
    /// `true` for a live flight: events and topics are served besides the page.
    pub is_live: bool,
}

/// Kind of response.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reply {
    /// The page, with a header `Set-Cookie`.
    Page(Option<String>),
    /// The stream of events.
    Events,
    /// All topics over a WebSocket.
    Topics {
        /// Key of the request.
        key: String,
        /// The chosen protocol.
        protocol: &'static str,
    },
}

impl Site {
    /// Returns the response to a request.
    ///
    /// # Errors
    /// The refusal of a request that is not permitted or has no response.
    pub fn reply(&self, request: &Request) -> Result<Reply, Refusal> {
        self.names.check(request)?;
        let cookie = match &self.token {
            Some(token) => token.check(request)?,
            None => None,
        };
        if let Some(upgrade) = &request.upgrade {
            // A page that sends the token in its URL got it from the user; a browser sends the cookie for any page.
            let is_permitted = cookie.is_some() || self.names.is_origin_permitted(request.origin.as_deref());
            return if is_permitted {
                self.topics(request, upgrade)
            } else {
                Err(OTHER_SITE)
            };
        }
        match request.path.as_str() {
            "/" => Ok(Reply::Page(cookie)),
            "/live" if self.is_live => {
                // Otherwise any page of the internet that a user of this machine opens could take all slots of
                // watchers.
                let site = request.fetch_site.as_deref();
                match site {
                    None | Some("same-origin" | "none") => Ok(Reply::Events),
                    Some(_) => Err(OTHER_SITE),
                }
            }
            _ => Err(NOT_FOUND),
        }
    }

    fn topics(&self, request: &Request, upgrade: &Upgrade) -> Result<Reply, Refusal> {
        if request.path != "/" || !self.is_live {
            return Err(NOT_FOUND);
        }
        let speaks = |protocol: &&str| upgrade.protocols.iter().any(|spoken| spoken == protocol);
        let protocol = PROTOCOLS.into_iter().find(speaks).ok_or(OTHER_PROTOCOL)?;
        let key = upgrade.key.clone();
        Ok(Reply::Topics { key, protocol })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::Ipv4Addr;

    fn request(path: &str, host: &str, query: &str) -> Request {
        Request {
            path: path.to_owned(),
            query: query.to_owned(),
            host: Some(host.to_owned()),
            ..Request::default()
        }
    }

    #[test]
    fn name_and_token_are_needed_for_everything_that_is_there_or_not() {
        let token = Token::new(&[7; 16], 1);
        let query = token.query().trim_start_matches('?').to_owned();
        let site = Site {
            names: HostNames::of(Ipv4Addr::new(10, 0, 0, 1).into(), &[]),
            token: Some(token),
            is_live: true,
        };
        let status = |host, query, path| {
            site.reply(&request(path, host, query))
                .map_err(|refusal| refusal.status)
        };
        for path in ["/", "/live", "/x"] {
            assert_eq!(status("evil.example", &query, path), Err(421), "{path}");
            assert_eq!(status("10.0.0.1", "", path), Err(401), "{path}");
        }
        assert!(matches!(
            status("10.0.0.1", &query, "/"),
            Ok(Reply::Page(Some(_)))
        ));
        assert_eq!(status("10.0.0.1", &query, "/live"), Ok(Reply::Events));
        assert_eq!(status("10.0.0.1", &query, "/x"), Err(404));
    }

    #[test]
    fn the_pages_of_other_sites_may_link_here_but_not_watch() {
        let site = Site {
            names: HostNames::of(Ipv4Addr::LOCALHOST.into(), &[]),
            token: None,
            is_live: true,
        };
        let from = |path, fetch_site: &str| {
            let request = Request {
                fetch_site: Some(fetch_site.to_owned()),
                ..request(path, "localhost", "")
            };
            site.reply(&request)
        };
        for other in ["cross-site", "same-site", "x"] {
            assert_eq!(from("/live", other), Err(OTHER_SITE));
            assert_eq!(from("/", other), Ok(Reply::Page(None)));
        }
        assert_eq!(from("/live", "same-origin"), Ok(Reply::Events));
        let finished = Site {
            is_live: false,
            ..site.clone()
        };
        assert_eq!(finished.reply(&request("/live", "localhost", "")), Err(NOT_FOUND));
    }

    #[test]
    fn all_topics_are_for_programs_and_for_pages_that_know_the_token() {
        let asked = |origin: Option<&str>, query: &str, protocol: &str| Request {
            origin: origin.map(str::to_owned),
            upgrade: Some(Upgrade {
                key: "k".to_owned(),
                protocols: vec!["x".to_owned(), protocol.to_owned()],
            }),
            ..request("/", "localhost", query)
        };
        let mut site = Site {
            names: HostNames::of(Ipv4Addr::LOCALHOST.into(), &[]),
            token: None,
            is_live: true,
        };
        let elsewhere = Some("https://app.example");
        for protocol in PROTOCOLS {
            let key = "k".to_owned();
            assert_eq!(
                site.reply(&asked(None, "", protocol)),
                Ok(Reply::Topics { key, protocol })
            );
            assert_eq!(site.reply(&asked(elsewhere, "", protocol)), Err(OTHER_SITE));
        }
        assert_eq!(site.reply(&asked(None, "", "y")), Err(OTHER_PROTOCOL));
        let token = Token::new(&[7; 16], 1);
        let query = token.query().trim_start_matches('?').to_owned();
        site.token = Some(token);
        let by_token = site.reply(&asked(elsewhere, &query, PROTOCOLS[1]));
        assert!(matches!(by_token, Ok(Reply::Topics { .. })), "{by_token:?}");
        site.is_live = false;
        assert_eq!(
            site.reply(&asked(elsewhere, &query, PROTOCOLS[1])),
            Err(NOT_FOUND)
        );
    }
}
