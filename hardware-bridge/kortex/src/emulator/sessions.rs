//! The sessions of an emulated arm.

use std::collections::BTreeMap;

use super::peer::Peer;
use crate::message::session::CreateSessionInfo;

/// One session.
#[derive(Debug, Clone, Copy)]
struct Record {
    peer: Peer,
    /// Session timeout, ms.
    session_timeout: u64,
    /// Connection timeout, ms.
    connection_timeout: u64,
    /// Time of the last call, ms.
    last_call: u64,
    /// Time of the last sign of life, ms.
    last_sign: u64,
}

/// All sessions, by number.
#[derive(Debug, Default)]
pub(super) struct Sessions {
    records: BTreeMap<u16, Record>,
    last: u16,
}

impl Sessions {
    /// Opens a session at time `now` (ms).
    pub(super) fn open(&mut self, peer: Peer, login: &CreateSessionInfo, now: u64) -> u16 {
        loop {
            self.last = self.last.wrapping_add(1);
            if self.last != 0 && !self.records.contains_key(&self.last) {
                break;
            }
        }
        // A timeout of 0 means the arm's default. This emulator never ends such a session.
        let or_never = |timeout: u32| if timeout == 0 { u64::MAX } else { u64::from(timeout) };
        let record = Record {
            peer,
            session_timeout: or_never(login.session_timeout),
            connection_timeout: or_never(login.connection_timeout),
            last_call: now,
            last_sign: now,
        };
        self.records.insert(self.last, record);
        self.last
    }

    /// True if session `number` belongs to `peer`. Notes the sign of life at `now` (ms).
    pub(super) fn hear(&mut self, number: u16, peer: Peer, is_call: bool, now: u64) -> bool {
        match self.records.get_mut(&number) {
            Some(record) if record.peer == peer => {
                record.last_sign = now;
                if is_call {
                    record.last_call = now;
                }
                true
            }
            _ => false,
        }
    }

    /// Ends a session. Returns true if there was one.
    pub(super) fn close(&mut self, number: u16) -> bool {
        self.records.remove(&number).is_some()
    }

    /// Ends the sessions that have timed out at `now` (ms), and returns their numbers.
    pub(super) fn expire(&mut self, now: u64) -> Vec<u16> {
        let expired = |record: &Record| {
            now - record.last_sign > record.connection_timeout || now - record.last_call > record.session_timeout
        };
        let ended: Vec<u16> =
            self.records.iter().filter(|(_, record)| expired(record)).map(|(number, _)| *number).collect();
        self.records.retain(|_, record| !expired(record));
        ended
    }

    /// Ends all sessions, and returns their numbers.
    pub(super) fn forget(&mut self) -> Vec<u16> {
        std::mem::take(&mut self.records).into_keys().collect()
    }

    /// Returns the numbers of the open sessions.
    pub(super) fn numbers(&self) -> Vec<u16> {
        self.records.keys().copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sessions_belong_to_their_peer_and_end_in_silence() {
        let mut sessions = Sessions::default();
        let login = CreateSessionInfo { session_timeout: 1000, connection_timeout: 200, ..Default::default() };
        let number = sessions.open(Peer::Tcp(1), &login, 0);
        assert!(sessions.hear(number, Peer::Tcp(1), false, 150));
        assert!(!sessions.hear(number, Peer::Tcp(2), false, 150), "another connection took it over");
        assert!(sessions.expire(350).is_empty());
        assert_eq!(sessions.expire(351), [number]);
        assert!(!sessions.close(number));
    }

    /// Keep-alives keep the connection, not the session.
    #[test]
    fn keep_alives_alone_are_not_enough() {
        let mut sessions = Sessions::default();
        let login = CreateSessionInfo { session_timeout: 1000, connection_timeout: 200, ..Default::default() };
        let number = sessions.open(Peer::Tcp(1), &login, 0);
        for now in (100..1000).step_by(100) {
            sessions.hear(number, Peer::Tcp(1), false, now);
            assert!(sessions.expire(now).is_empty());
        }
        sessions.hear(number, Peer::Tcp(1), false, 1001);
        assert_eq!(sessions.expire(1001), [number]);
    }
}
