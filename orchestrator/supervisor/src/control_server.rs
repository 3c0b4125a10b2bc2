//! The control server of a flight, which answers `gerono arm`, `kill`, `top`, `view` and the like.
//!
//! It never waits for a client: it accepts new ones, answers pending questions, and returns. A client cannot take time
//! from the flight or a slot from another client: there is one answer a round, a message has a maximum size, and when
//! all slots are in use the client that was silent for longest is closed. A file descriptor is reserved for a client that
//! comes when this process can open no more files. So a `kill` always arrives.

use std::os::fd::OwnedFd;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use runtime::control::{Channel, Host};
use runtime::peer::peer_credentials;
use rustix::fs::{Mode, fchmod};
use rustix::io::Errno;
use rustix::net::{AddressFamily, RecvFlags, SocketAddrUnix, SocketFlags, SocketType};

use crate::supervision::descriptor_reserve::reserved_descriptor;
use postmortem::contained;
use run_client::run_root::RunRoot;
use run_client::runs::OrchestratorLabel;
use run_client::{Answer, Question, SOCKET, may_operate};

/// Maximum number of clients.
const CLIENTS: usize = 16;

/// Maximum number of clients accepted in a round.
const MAX_ACCEPTS: usize = 2 * CLIENTS;

/// Length of the listen queue.
const BACKLOG: i32 = 64;

/// Timeout of a silent client. `gerono top` asks several times a second.
const SILENCE: Duration = Duration::from_secs(30);

/// Maximum length of a question, bytes; usual ones have some tens.
const MAX_QUESTION: usize = 4096;

/// Control server of a run. Its socket is removed with the run's folder.
pub struct ControlServer {
    listener: OwnedFd,
    /// Sorted by their last question, the longest silent first.
    clients: Vec<Client>,
    /// Gives its descriptor to a client for which there is no other.
    reserved: Option<OwnedFd>,
    question: Box<[u8; MAX_QUESTION]>,
    /// Makes the run discoverable while none of its services lives.
    _label: OrchestratorLabel,
}

/// Connected client.
struct Client {
    channel: Channel,
    /// Time of the connection or the last question.
    last_question_at: Instant,
    /// `true` if it was answered in this round.
    is_answered: bool,
}

/// State of a client after its socket was read.
#[derive(PartialEq)]
enum ClientRequest {
    Nothing,
    Question,
    /// The client has disconnected, or does not read its answers.
    End,
}

impl ControlServer {
    /// Opens the control server of a run.
    ///
    /// # Errors
    /// If the socket cannot be created.
    pub fn open(root: &RunRoot, host: Host) -> std::io::Result<Self> {
        let path: PathBuf = root.folder().join(SOCKET);
        // Left by an earlier orchestrator of the run.
        let _ = std::fs::remove_file(&path);
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let listener = rustix::net::socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?;
        // Must precede `bind`: the socket file takes its mode from the socket, so it is never open to others, whatever the
        // umask is.
        fchmod(&listener, Mode::RUSR | Mode::WUSR)?;
        rustix::net::bind(&listener, &SocketAddrUnix::new(&path)?)?;
        rustix::net::listen(&listener, BACKLOG)?;
        Ok(Self {
            listener,
            clients: Vec::with_capacity(CLIENTS),
            reserved: reserved_descriptor().ok(),
            question: Box::new([0; MAX_QUESTION]),
            // Must be last: a process that finds the run can then connect.
            _label: OrchestratorLabel::new(root.folder(), host)?,
        })
    }

    /// Accepts new clients and answers the questions of all clients, one a client.
    pub fn serve(&mut self, mut answer: impl FnMut(Question) -> Answer) {
        let now = Instant::now();
        for client in &mut self.clients {
            client.is_answered = false;
        }
        self.answer_all(now, &mut answer);
        for _ in 0..MAX_ACCEPTS {
            let Some(socket) = self.accept(now, &mut answer) else {
                break;
            };
            let channel = Channel::inherited(socket);
            // The folder is closed to other users; this check holds even if its mode was changed.
            if let Err(refusal) = admit(&channel) {
                // A client that does not read the refusal is closed anyway.
                let _ = channel.try_send(&Answer::Refused(refusal));
                continue;
            }
            if self.clients.len() == CLIENTS {
                self.make_room(now, &mut answer);
            }
            self.clients.push(Client {
                channel,
                last_question_at: now,
                is_answered: false,
            });
        }
        self.answer_all(now, &mut answer);
        if self.reserved.is_none() {
            self.reserved = reserved_descriptor().ok();
        }
    }

    /// Accepts a client that waits. Without a free descriptor it gets the reserved one, or else that of the client that was
    /// silent for longest.
    fn accept(&mut self, now: Instant, answer: &mut impl FnMut(Question) -> Answer) -> Option<OwnedFd> {
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let accepted = rustix::net::accept_with(&self.listener, flags);
        if !matches!(accepted, Err(Errno::MFILE | Errno::NFILE)) {
            return accepted.ok();
        }
        if self.reserved.take().is_none() && !self.clients.is_empty() {
            self.make_room(now, answer);
        }
        rustix::net::accept_with(&self.listener, flags).ok()
    }

    /// Answers pending questions, and closes disconnected and silent clients.
    fn answer_all(&mut self, now: Instant, answer: &mut impl FnMut(Question) -> Answer) {
        let question = &mut *self.question;
        self.clients.retain_mut(|client| {
            let request = client.answer_pending(now, question, answer);
            let is_silent = now.duration_since(client.last_question_at) > SILENCE;
            if is_silent {
                client.close("no question for too long");
            }
            request != ClientRequest::End && !is_silent
        });
        self.clients.sort_by_key(|client| client.last_question_at);
    }

    /// Closes the client that was silent for longest. A question that has just arrived is answered first.
    fn make_room(&mut self, now: Instant, answer: &mut impl FnMut(Question) -> Answer) {
        let question = &mut *self.question;
        let silent = self
            .clients
            .iter_mut()
            .position(|client| client.answer_pending(now, question, answer) != ClientRequest::Question);
        self.clients
            .remove(silent.unwrap_or(0))
            .close("too many clients: this one was silent for longest");
    }
}

/// Returns the reason if the client may not ask.
fn admit(channel: &Channel) -> Result<(), String> {
    let peer = peer_credentials(channel).map_err(|error| format!("cannot identify the client: {error}"))?;
    if may_operate(peer.user) {
        return Ok(());
    }
    Err(format!(
        "the run takes requests of its owner and of root, and the user {} asks, as this run sees it",
        peer.user
    ))
}

impl Client {
    /// Answers the client's question, if one is pending and none was answered in this round.
    fn answer_pending(
        &mut self,
        now: Instant,
        buffer: &mut [u8],
        answer: &mut impl FnMut(Question) -> Answer,
    ) -> ClientRequest {
        if self.is_answered {
            return ClientRequest::Nothing;
        }
        // TRUNC returns the length of the message even if it exceeds the buffer.
        let flags = RecvFlags::DONTWAIT | RecvFlags::TRUNC;
        let received = rustix::io::retry_on_intr(|| rustix::net::recv(&self.channel, &mut *buffer, flags));
        let question = match received {
            Err(Errno::AGAIN) => return ClientRequest::Nothing,
            Ok((_, 0)) | Err(_) => return ClientRequest::End,
            Ok((_, length)) => buffer.get(..length),
        };
        let answer = match question.map(serde_json::from_slice::<Question>) {
            Some(Ok(question)) if question.ends_with_its_client() && self.channel.is_hung_up() => {
                return ClientRequest::End;
            }
            Some(Ok(question)) => contained(|| answer(question)).unwrap_or_else(|| {
                let reason =
                    "this request failed by a defect of gerono, shown on the terminal of the flight; the flight continues";
                Answer::Refused(reason.to_owned())
            }),
            Some(Err(error)) => Answer::Refused(format!("the question is malformed: {error}")),
            None => Answer::Refused(format!("a question has at most {MAX_QUESTION} bytes")),
        };
        (self.last_question_at, self.is_answered) = (now, true);
        // A client whose socket is full does not read its answers.
        match self.channel.try_send(&answer) {
            Ok(true) => ClientRequest::Question,
            _ => ClientRequest::End,
        }
    }

    fn close(&self, why: &str) {
        // The client is closed whether or not it receives the reason.
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
        let long = format!("\"{}\"", "x".repeat(MAX_QUESTION));
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
        assert!(matches!(answer(&client), Some(Answer::Refused(reason)) if reason.contains("continues")));
        client.send(&KILL).unwrap();
        assert_eq!(server.serve(), 1);
    }

    #[test]
    fn a_client_that_is_silent_for_long_is_let_go() {
        let mut server = Server::open();
        let client = server.client();
        server.serve();
        server.server.clients[0].last_question_at -= SILENCE + Duration::from_secs(1);
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
