//! The control server of a flight: where `gerono arm`, `kill`, `top`, `view` and the like ask their questions.
//!
//! It never waits for a client: it takes the new ones, answers the questions that have come, and goes on. A client can
//! take neither the flight's time nor another client's place: there is one answer a round, a message has a largest size,
//! and when all places are taken the client that has been silent for longest makes room. So a `kill` always comes through.

use std::os::fd::OwnedFd;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use runtime::control::{Channel, Host};
use runtime::peer::peer_credentials;
use rustix::fs::{Mode, fchmod};
use rustix::net::{AddressFamily, RecvFlags, SocketAddrUnix, SocketFlags, SocketType};

use postmortem::contained;
use run_client::run_root::RunRoot;
use run_client::runs::OrchestratorLabel;
use run_client::{Answer, Question, SOCKET, may_operate};

/// Clients that are heard at once.
const CLIENTS: usize = 16;

/// Clients that are taken in one round.
const TAKEN_AT_ONCE: usize = 2 * CLIENTS;

/// Clients that the system keeps until they are taken.
const BACKLOG: i32 = 64;

/// Silence after which a client is let go. `gerono top` asks several times a second.
const SILENCE: Duration = Duration::from_secs(30);

/// Longest question, bytes; the longest there is has some tens.
const LONGEST_QUESTION: usize = 4096;

/// The control server of a run. Its socket goes with the run's place.
pub struct ControlServer {
    listener: OwnedFd,
    /// Those that have been silent for longest come first.
    clients: Vec<Client>,
    question: Box<[u8; LONGEST_QUESTION]>,
    /// By it the run is found while none of its services lives.
    _label: OrchestratorLabel,
}

/// A program that asks.
struct Client {
    channel: Channel,
    /// Time at which it came or asked last.
    heard: Instant,
    /// `true` if it has had its answer of this round.
    is_served: bool,
}

/// The request of a client.
#[derive(PartialEq)]
enum ClientRequest {
    Nothing,
    Question,
    /// It is gone, or does not take its answers.
    End,
}

impl ControlServer {
    /// Opens the control server of a run.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn open(root: &RunRoot, host: Host) -> std::io::Result<Self> {
        let path: PathBuf = root.folder().join(SOCKET);
        // That of an orchestrator which has died, if this one takes its place.
        let _ = std::fs::remove_file(&path);
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let listener = rustix::net::socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?;
        // A socket gets the mode that it has when it is bound, whatever the umask permits.
        fchmod(&listener, Mode::RUSR | Mode::WUSR)?;
        rustix::net::bind(&listener, &SocketAddrUnix::new(&path)?)?;
        rustix::net::listen(&listener, BACKLOG)?;
        Ok(Self {
            listener,
            clients: Vec::with_capacity(CLIENTS),
            question: Box::new([0; LONGEST_QUESTION]),
            // Last: a process that finds the run can connect.
            _label: OrchestratorLabel::new(root.folder(), host)?,
        })
    }

    /// Takes new clients, and answers what all of them ask, one question a client.
    pub fn serve(&mut self, mut answer: impl FnMut(Question) -> Answer) {
        let now = Instant::now();
        for client in &mut self.clients {
            client.is_served = false;
        }
        self.hear_all(now, &mut answer);
        for _ in 0..TAKEN_AT_ONCE {
            let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
            let Ok(socket) = rustix::net::accept_with(&self.listener, flags) else {
                break;
            };
            let channel = Channel::inherited(socket);
            // The folder of the socket is closed to other users; this holds even if that was opened to them.
            if let Err(refusal) = admit(&channel) {
                // A client that does not take its answer at once has no use for it.
                let _ = channel.try_send(&Answer::Refused(refusal));
                continue;
            }
            if self.clients.len() == CLIENTS {
                self.make_room(now, &mut answer);
            }
            self.clients.push(Client {
                channel,
                heard: now,
                is_served: false,
            });
        }
        self.hear_all(now, &mut answer);
    }

    /// Answers the questions that have come, and lets go the clients that are gone or silent.
    fn hear_all(&mut self, now: Instant, answer: &mut impl FnMut(Question) -> Answer) {
        let question = &mut *self.question;
        self.clients.retain_mut(|client| {
            let heard = client.hear(now, question, answer);
            let is_silent = now.duration_since(client.heard) > SILENCE;
            if is_silent {
                client.dismiss("nothing was asked for too long");
            }
            heard != ClientRequest::End && !is_silent
        });
        self.clients.sort_by_key(|client| client.heard);
    }

    /// Lets go the client that has been silent for longest. A question that it has asked meanwhile is answered first.
    fn make_room(&mut self, now: Instant, answer: &mut impl FnMut(Question) -> Answer) {
        let question = &mut *self.question;
        let silent = self
            .clients
            .iter_mut()
            .position(|client| client.hear(now, question, answer) != ClientRequest::Question);
        self.clients
            .remove(silent.unwrap_or(0))
            .dismiss("other clients needed its place");
    }
}

/// Returns why a client may not ask, if it may not.
fn admit(channel: &Channel) -> Result<(), String> {
    let peer =
        peer_credentials(channel).map_err(|error| format!("the system does not say who asks: {error}"))?;
    if may_operate(peer.user) {
        return Ok(());
    }
    Err(format!(
        "the run takes requests of its owner and of root, and the user {} asks, as this run sees it",
        peer.user
    ))
}

impl Client {
    /// Answers its question, if it has one and has not had an answer in this round.
    fn hear(
        &mut self,
        now: Instant,
        buffer: &mut [u8],
        answer: &mut impl FnMut(Question) -> Answer,
    ) -> ClientRequest {
        if self.is_served {
            return ClientRequest::Nothing;
        }
        // TRUNC: the length that the message has, even if that is more than there is room for.
        let flags = RecvFlags::DONTWAIT | RecvFlags::TRUNC;
        let received = rustix::io::retry_on_intr(|| rustix::net::recv(&self.channel, &mut *buffer, flags));
        let question = match received {
            Err(rustix::io::Errno::AGAIN) => return ClientRequest::Nothing,
            Ok((_, 0)) | Err(_) => return ClientRequest::End,
            Ok((_, length)) => buffer.get(..length),
        };
        let answer = match question.map(serde_json::from_slice::<Question>) {
            Some(Ok(question)) if question.ends_with_its_client() && self.channel.is_hung_up() => {
                return ClientRequest::End;
            }
            Some(Ok(question)) => contained(|| answer(question)).unwrap_or_else(|| {
                let reason =
                    "this met a defect of gerono, which the terminal of the flight shows; the flight goes on";
                Answer::Refused(reason.to_owned())
            }),
            Some(Err(error)) => Answer::Refused(format!("this cannot be understood: {error}")),
            None => Answer::Refused(format!("a question has at most {LONGEST_QUESTION} bytes")),
        };
        (self.heard, self.is_served) = (now, true);
        // A client that does not take its answer at once has no use for it.
        match self.channel.try_send(&answer) {
            Ok(true) => ClientRequest::Question,
            _ => ClientRequest::End,
        }
    }

    fn dismiss(&self, why: &str) {
        // It ends in any case.
        let _ = self.channel.try_send(&Answer::Closed(why.to_owned()));
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::MetadataExt;

    use runtime::control::ControlError;
    use runtime::shared_page::Request;
    use rustix::net::SendFlags;

    use super::*;
    use run_client::connect;

    const KILL: Question = Question::Operate(Request::Kill);

    struct Server {
        root: RunRoot,
        server: ControlServer,
    }

    impl Server {
        fn open() -> Self {
            let root = RunRoot::create().unwrap();
            let server = ControlServer::open(&root, Host::RealTime).unwrap();
            Self { root, server }
        }

        fn client(&self) -> Channel {
            let socket = self.root.folder().join(SOCKET);
            connect(&socket, Instant::now()).unwrap()
        }

        /// Serves one round, in which kills are obeyed; how many there were.
        fn serve(&mut self) -> usize {
            let mut kills = 0;
            self.server.serve(|question| {
                kills += usize::from(question == KILL);
                Answer::Done(String::new())
            });
            kills
        }
    }

    fn answer(client: &Channel) -> Option<Answer> {
        client.try_receive().unwrap()
    }

    #[test]
    fn a_question_is_answered_and_a_client_that_goes_is_forgotten() {
        let mut server = Server::open();
        let client = server.client();
        client
            .send(&Question::KillService("controller".to_owned()))
            .unwrap();
        server.server.serve(|question| match question {
            Question::KillService(service) => Answer::Done(service),
            _ => Answer::Refused(String::new()),
        });
        assert_eq!(answer(&client), Some(Answer::Done("controller".to_owned())));
        drop(client);
        server.serve();
        assert!(server.server.clients.is_empty());
    }

    #[test]
    fn a_kill_comes_through_however_many_clients_are_silent_or_do_not_read() {
        let mut server = Server::open();
        let mut silent = Vec::new();
        for _ in 0..4 * CLIENTS {
            silent.push(server.client());
            server.serve();
        }
        // These ask and ask and never read.
        for client in silent.iter().rev().take(CLIENTS) {
            while client.try_send(&Question::Look).is_ok_and(|sent| sent) {}
        }
        let kill = server.client();
        kill.send(&KILL).unwrap();
        assert_eq!(server.serve(), 1);
        assert!(matches!(answer(&kill), Some(Answer::Done(_))));
        assert!(matches!(answer(&silent[0]), Some(Answer::Closed(_))));
        assert!(server.server.clients.len() <= CLIENTS);
    }

    #[test]
    fn a_client_that_is_let_go_is_heard_before() {
        let mut server = Server::open();
        let clients: Vec<_> = (0..CLIENTS).map(|_| server.client()).collect();
        server.serve();
        clients[0].send(&KILL).unwrap();
        let _newcomers: Vec<_> = (0..CLIENTS).map(|_| server.client()).collect();
        assert_eq!(server.serve(), 1);
    }

    #[test]
    fn what_a_client_has_given_up_does_not_happen_but_a_kill_does() {
        let mut server = Server::open();
        for question in [
            Question::Operate(Request::Arm),
            Question::Operate(Request::Disarm),
            Question::Operate(Request::Land),
            Question::Stop,
            Question::Set(vec!["controller.k1=5".to_owned()]),
            Question::KillService("controller".to_owned()),
        ] {
            let client = server.client();
            client.send(&question).unwrap();
            drop(client);
            let mut has_happened = false;
            server.server.serve(|_| {
                has_happened = true;
                Answer::Done(String::new())
            });
            assert!(!has_happened, "{question:?}");
        }
        let client = server.client();
        client.send(&KILL).unwrap();
        drop(client);
        assert_eq!(server.serve(), 1);
    }

    #[test]
    fn a_client_gets_one_answer_a_round() {
        let mut server = Server::open();
        let client = server.client();
        for _ in 0..3 {
            client.send(&KILL).unwrap();
        }
        assert_eq!(
            [server.serve(), server.serve(), server.serve(), server.serve()],
            [1, 1, 1, 0]
        );
    }

    #[test]
    fn what_is_no_question_or_too_long_is_refused_and_the_next_is_answered() {
        let mut server = Server::open();
        let client = server.client();
        let long = format!("\"{}\"", "x".repeat(LONGEST_QUESTION));
        for nonsense in ["{\"operate\":", long.as_str(), "[[[[[["] {
            rustix::net::send(&client, nonsense.as_bytes(), SendFlags::empty()).unwrap();
            assert_eq!(server.serve(), 0);
            assert!(matches!(answer(&client), Some(Answer::Refused(_))), "{nonsense}");
        }
        client.send(&KILL).unwrap();
        assert_eq!(server.serve(), 1);
    }

    #[test]
    fn a_question_whose_answer_panics_is_refused_and_the_next_is_answered() {
        let mut server = Server::open();
        let client = server.client();
        client
            .send(&Question::Set(vec!["controller.k1=5".to_owned()]))
            .unwrap();
        server.server.serve(|_| panic!("this question is a defect"));
        assert!(matches!(answer(&client), Some(Answer::Refused(reason)) if reason.contains("goes on")));
        client.send(&KILL).unwrap();
        assert_eq!(server.serve(), 1);
    }

    #[test]
    fn a_client_that_is_silent_for_long_is_let_go() {
        let mut server = Server::open();
        let client = server.client();
        server.serve();
        server.server.clients[0].heard -= SILENCE + Duration::from_secs(1);
        server.serve();
        assert!(server.server.clients.is_empty());
        assert!(matches!(answer(&client), Some(Answer::Closed(_))));
        assert!(matches!(
            client.try_receive::<Answer>(),
            Err(ControlError::Closed)
        ));
    }

    #[test]
    fn only_its_owner_may_open_the_socket_whatever_the_umask() {
        let before = rustix::process::umask(Mode::empty());
        let server = Server::open();
        rustix::process::umask(before);
        let socket = std::fs::metadata(server.root.folder().join(SOCKET)).unwrap();
        assert_eq!(socket.mode() & 0o777, 0o600);
    }
}
