//! A session: calls with deadlines, keep-alives, notifications.
//!
//! The arm ends a session for two reasons: no sign of life for its connection timeout, or no *call* for its session
//! timeout. Keep-alives are signs of life but not calls. So [`Session::keep_up`] sends both: a keep-alive every
//! [`Timeouts::keep_alive`], and a cheap call if no other one was made for a while.
//!
//! There is no thread here: the owner of a session calls [`Session::keep_up`] often enough. If the host hangs, its
//! signs of life stop and the arm notices. A helper thread would keep the session of a dead controller alive.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use prost::Message;

use crate::call::{self, Call};
use crate::error::KortexError;
use crate::frame::is_younger;
use crate::frame::{Frame, FrameKind, Header};
use crate::link::Link;
use crate::message::Empty;
use crate::message::session::CreateSessionInfo;
use crate::refusal::{Reason, Refusal};
use crate::tap::Tap;

/// User and password of the arm's web page. `Debug` leaves the password out.
#[derive(Clone, PartialEq, Eq)]
pub struct Credentials {
    /// User name.
    pub user: String,
    /// Password, which crosses the network in clear text.
    pub password: String,
}

impl std::fmt::Debug for Credentials {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Credentials {{ user: {:?} }}", self.user)
    }
}

/// Number of keeping calls per session timeout: some may be lost or late.
const CALLS_PER_TIMEOUT: u32 = 6;

/// Deadlines of a session.
///
/// # Example
/// ```
/// use std::time::Duration;
///
/// use kinova_kortex::Timeouts;
///
/// // A slow network: calls may take three seconds.
/// let timeouts = Timeouts { call: Duration::from_secs(3), ..Timeouts::default() };
/// assert!(timeouts.keep_alive < timeouts.connection);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Timeouts {
    /// Time limit for a call's answer.
    pub call: Duration,
    /// Session timeout: time for which the arm keeps a session without calls.
    pub session: Duration,
    /// Connection timeout: time for which the arm keeps a session without any sign of life. It is also our time limit
    /// for the arm's silence.
    pub connection: Duration,
    /// Interval between keep-alives.
    pub keep_alive: Duration,
}

impl Default for Timeouts {
    /// Session and connection timeouts are those of the maker's ROS 2 driver, the keep-alive is that of its Python
    /// client.
    fn default() -> Self {
        Self {
            call: Duration::from_secs(1),
            session: Duration::from_secs(60),
            connection: Duration::from_secs(2),
            keep_alive: Duration::from_millis(150),
        }
    }
}

/// A silence of this program longer than a session allows.
#[derive(Debug, Clone, Copy)]
struct Neglect {
    silent: Duration,
    allowed: Duration,
    /// Number of the first message after the silence. An answer to it shows that the session is alive.
    message: u16,
}

/// A session on a link. Dropping it closes it as well as is possible without waiting.
///
/// [`Arm`](crate::Arm) has one for each interface; one of your own makes calls that [`Base`](crate::base::Base) does not have.
///
/// # Example
/// ```
/// # use kinova_kortex::emulator::{Emulator, FirstOrderJoints, Pace, Settings};
/// # use kinova_kortex::Timeouts;
/// # let settings = Settings { cyclic_deadline: 60_000, ..Settings::default() };
/// # let credentials = settings.credentials.clone();
/// # let emulator = Emulator::start(settings, Box::new(FirstOrderJoints::gen3()), Pace::RealTime)?;
/// use kinova_kortex::call;
/// use kinova_kortex::link::TcpLink;
/// use kinova_kortex::message::Empty;
/// use kinova_kortex::message::base::ArmStateInformation;
/// use kinova_kortex::session::Session;
///
/// let timeouts = Timeouts::default();
/// let link = TcpLink::connect(emulator.address().tcp, timeouts.call)?;
/// let mut session = Session::create(link, &credentials, timeouts, call::GET_ARM_STATE)?;
/// let answer: ArmStateInformation = session.call(call::GET_ARM_STATE, 0, &Empty {})?;
/// println!("{:?}", answer.active_state());
/// session.close()?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Session<L: Link> {
    link: L,
    number: u16,
    next_message: u16,
    timeouts: Timeouts,
    next_keep_alive: Instant,
    /// Call that keeps the session if no other is made: of the base, without an argument, and cheap.
    kept_by: Call,
    /// Numbers of such calls that were sent but not answered.
    keeping: VecDeque<u16>,
    /// Time at which anything was sent last.
    last_sign: Instant,
    /// Time at which a call was sent last.
    last_call: Instant,
    /// Time since which the arm owes us a sign of life.
    unanswered: Option<Instant>,
    neglected: Option<Neglect>,
    notifications: VecDeque<Frame>,
    stray: u64,
}

impl<L: Link> Session<L> {
    /// Logs in. The session calls `kept_by`, a cheap call without an argument, if no other call is made for long.
    ///
    /// # Errors
    /// [`KortexError::Refused`] with [`crate::refusal::Reason::Login`] for a wrong name or password; a link's errors;
    /// no answer.
    pub fn create(link: L, credentials: &Credentials, timeouts: Timeouts, kept_by: Call) -> Result<Self, KortexError> {
        let now = Instant::now();
        let next_keep_alive = now + timeouts.connection;
        let mut session = Self {
            link,
            number: 0,
            next_message: 1,
            timeouts,
            next_keep_alive,
            kept_by,
            keeping: VecDeque::new(),
            last_sign: now,
            last_call: now,
            unanswered: None,
            neglected: None,
            notifications: VecDeque::new(),
            stray: 0,
        };
        let login = CreateSessionInfo {
            user: credentials.user.clone(),
            session_timeout: timeouts.session.as_millis() as u32,
            password: credentials.password.clone(),
            connection_timeout: timeouts.connection.as_millis() as u32,
        };
        let answer = session.answer(call::CREATE_SESSION, 0, &login)?;
        session.number = answer.header.session;
        session.next_keep_alive = Instant::now() + timeouts.keep_alive;
        Ok(session)
    }

    /// Returns the number of the session.
    pub fn number(&self) -> u16 {
        self.number
    }

    /// Returns the timeouts of the session.
    pub fn timeouts(&self) -> Timeouts {
        self.timeouts
    }

    /// Copies everything that crosses the link from now on into `tap`, which is after the login.
    pub fn tap(&mut self, tap: Tap) {
        self.link.tap(tap);
    }

    /// Returns the number of frames that answered no pending call.
    pub fn stray(&self) -> u64 {
        self.stray
    }

    /// Returns the number of datagrams dropped because they were damaged.
    pub fn damaged(&self) -> u64 {
        self.link.damaged()
    }

    /// Calls `call` of `device` (0: the base) and waits for its answer.
    ///
    /// # Errors
    /// A refusal, no answer in time, a link's errors, an answer of another type.
    pub fn call<A: Message + Default>(
        &mut self,
        call: Call,
        device: u8,
        argument: &impl Message,
    ) -> Result<A, KortexError> {
        let answer = self.answer(call, device, argument)?;
        decode(&answer)
    }

    fn answer(&mut self, call: Call, device: u8, argument: &impl Message) -> Result<Frame, KortexError> {
        let message = self.post(call, device, argument)?;
        let after = self.timeouts.call;
        let deadline = Instant::now() + after;
        while let Some(frame) = self.next_response(deadline)? {
            if frame.header.message != message || frame.header.call != call {
                self.stray += 1;
                continue;
            }
            return match Refusal::of(&frame) {
                Some(refusal) => Err(self.refused(call, refusal)),
                None => Ok(frame),
            };
        }
        Err(KortexError::Timeout { call, after })
    }

    /// Sends a call and returns its number. [`Session::next_response`] returns the answer.
    ///
    /// # Errors
    /// The link's.
    pub fn post(&mut self, call: Call, device: u8, argument: &impl Message) -> Result<u16, KortexError> {
        self.note_sign(call != call::KEEP_ALIVE);
        let message = self.next_message;
        self.next_message = self.next_message.wrapping_add(1);
        let (session, kind) = (self.number, FrameKind::Request);
        let header = Header { kind, device, error: 0, sub_error: 0, session, message, call };
        self.link.send(&Frame { header, payload: argument.encode_to_vec() })?;
        Ok(message)
    }

    /// Notes a sign of life, and whether the session may have ended before it.
    fn note_sign(&mut self, is_call: bool) {
        let now = Instant::now();
        let Timeouts { session, connection, .. } = self.timeouts;
        for (last, allowed) in [(self.last_sign, connection), (self.last_call, session)] {
            let silent = now - last;
            if self.number != 0 && silent > allowed {
                self.neglected = Some(Neglect { silent, allowed, message: self.next_message });
            }
        }
        self.last_sign = now;
        if is_call {
            self.last_call = now;
        }
    }

    /// Notes an answer. One to a message after a neglect shows that the session has survived it.
    fn note_answer(&mut self, header: &Header) {
        let since = |first: u16| header.message == first || is_younger(header.message, first);
        if header.kind == FrameKind::Response && header.error == 0 && self.neglected.is_some_and(|it| since(it.message))
        {
            self.neglected = None;
        }
    }

    /// Converts a refusal to an error. The arm does not report why it no longer knows a session; the reason follows
    /// from the time for which this program was silent.
    pub fn refused(&self, call: Call, refusal: Refusal) -> KortexError {
        let session = self.number;
        match (refusal.reason, self.neglected) {
            (Reason::InvalidSession, Some(Neglect { silent, allowed, .. })) => {
                KortexError::SessionExpired { call, session, silent, allowed }
            }
            (Reason::InvalidSession, None) => KortexError::SessionLost { call, session },
            _ => KortexError::Refused { call, refusal },
        }
    }

    /// Returns the next answer to a call of the owner's, waiting until `deadline`. Meanwhile it stores notifications
    /// and keeps the session alive.
    ///
    /// # Errors
    /// The link's; [`KortexError::SessionLost`] or [`KortexError::SessionExpired`] if the arm no longer knows the
    /// session; [`KortexError::Silent`].
    pub fn next_response(&mut self, deadline: Instant) -> Result<Option<Frame>, KortexError> {
        loop {
            let now = Instant::now();
            if now >= self.next_keep_alive {
                self.keep_session(now)?;
                self.post(call::KEEP_ALIVE, 0, &Empty {})?;
                self.next_keep_alive = now + self.timeouts.keep_alive;
                self.unanswered.get_or_insert(now);
            }
            let Some(frame) = self.link.receive(deadline.min(self.next_keep_alive))? else {
                let silent = self.unanswered.map_or(Duration::ZERO, |since| since.elapsed());
                if silent > self.timeouts.connection {
                    return Err(KortexError::Silent { silent, allowed: self.timeouts.connection });
                }
                if Instant::now() >= deadline {
                    return Ok(None);
                }
                continue;
            };
            self.unanswered = None;
            self.note_answer(&frame.header);
            match (frame.header.kind, frame.header.call) {
                (FrameKind::Response, call::KEEP_ALIVE) => {
                    if let Some(refusal) = Refusal::of(&frame) {
                        return Err(self.refused(call::KEEP_ALIVE, refusal));
                    }
                }
                (FrameKind::Response, _) => {
                    let Some(place) = self.keeping.iter().position(|sent| *sent == frame.header.message) else {
                        return Ok(Some(frame));
                    };
                    self.keeping.remove(place);
                    // Even if it is refused for another reason, it was a call.
                    if let Some(refusal) = Refusal::of(&frame).filter(|no| no.reason == Reason::InvalidSession) {
                        return Err(self.refused(self.kept_by, refusal));
                    }
                }
                (FrameKind::Notification, _) => self.notifications.push_back(frame),
                (FrameKind::Request, _) => self.stray += 1,
            }
        }
    }

    /// Makes the call that keeps the session, if no other one was made for a share of its timeout.
    fn keep_session(&mut self, now: Instant) -> Result<(), KortexError> {
        if self.number == 0 || now - self.last_call < self.timeouts.session / CALLS_PER_TIMEOUT {
            return Ok(());
        }
        let message = self.post(self.kept_by, 0, &Empty {})?;
        self.keeping.push_back(message);
        if self.keeping.len() > CALLS_PER_TIMEOUT as usize {
            self.keeping.pop_front();
        }
        Ok(())
    }

    /// Keeps the session alive and takes in everything that has arrived, without waiting. Call it every few
    /// milliseconds.
    ///
    /// # Errors
    /// As [`Session::next_response`].
    pub fn keep_up(&mut self) -> Result<(), KortexError> {
        let now = Instant::now();
        while self.next_response(now)?.is_some() {
            self.stray += 1;
        }
        Ok(())
    }

    /// Returns the oldest notification not yet taken.
    pub fn next_notification(&mut self) -> Option<Frame> {
        self.notifications.pop_front()
    }

    /// Logs out and waits for the arm's answer.
    ///
    /// # Errors
    /// As [`Session::call`].
    pub fn close(mut self) -> Result<(), KortexError> {
        let result = self.call::<Empty>(call::CLOSE_SESSION, 0, &Empty {});
        self.number = 0;
        result.map(|_| ())
    }
}

impl<L: Link> Drop for Session<L> {
    fn drop(&mut self) {
        if self.number != 0 {
            // There is nobody left to report to. The arm's own timeout ends a session whose log-out is lost.
            drop(self.post(call::CLOSE_SESSION, 0, &Empty {}));
        }
    }
}

/// Decodes the payload of `frame` as an `A`.
///
/// # Errors
/// [`KortexError::Answer`].
pub(super) fn decode<A: Message + Default>(frame: &Frame) -> Result<A, KortexError> {
    A::decode(frame.payload.as_slice()).map_err(|error| KortexError::Answer {
        call: frame.header.call,
        field: "payload",
        found: format!("{} bytes ({error})", frame.payload.len()),
        expected: "its message".to_owned(),
    })
}
