//! A TCP or Unix socket, as its address requires.

use std::fmt;
use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream, ToSocketAddrs as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::mpsc;
use std::time::Duration;

/// Address of a vision system: `HOST:PORT`, or `unix:PATH`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Address {
    Tcp(String),
    Unix(PathBuf),
}

impl FromStr for Address {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(path) = text.strip_prefix("unix:").filter(|path| !path.is_empty()) {
            return Ok(Self::Unix(path.into()));
        }
        match text.rsplit_once(':') {
            Some((host, port)) if !host.is_empty() && port.parse::<u16>().is_ok() => Ok(Self::Tcp(text.to_owned())),
            _ => Err(format!("found `{text}`, expected HOST:PORT or unix:PATH")),
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Tcp(address) => f.write_str(address),
            Self::Unix(path) => write!(f, "unix:{}", path.display()),
        }
    }
}

/// An open connection.
pub enum DetectorStream {
    Tcp(TcpStream),
    Unix(UnixStream),
}

impl DetectorStream {
    /// Connects to `address` within `limit`.
    pub fn connect(address: &Address, limit: Duration) -> io::Result<Self> {
        let (sender, receiver) = mpsc::channel();
        let to = address.clone();
        // Neither resolving a name nor connecting to a Unix socket has a time limit of its own, so both run in a thread
        // that is abandoned if it takes longer.
        std::thread::Builder::new().name("connect".into()).spawn(move || sender.send(connect(&to, limit)))?;
        match receiver.recv_timeout(limit) {
            Ok(Ok(stream)) => Ok(stream),
            Ok(Err(error)) if error.kind() != io::ErrorKind::TimedOut => Err(error),
            // Either time limit may expire first.
            _ => {
                let words =
                    format!("found no answer within {:.0} s, expected a listening vision system", limit.as_secs_f64());
                Err(io::Error::new(io::ErrorKind::TimedOut, words))
            }
        }
    }

    /// Returns another handle of the same connection.
    pub fn try_clone(&self) -> io::Result<Self> {
        match self {
            Self::Tcp(stream) => stream.try_clone().map(Self::Tcp),
            Self::Unix(stream) => stream.try_clone().map(Self::Unix),
        }
    }

    /// Ends the connection for all of its handles.
    pub fn shutdown(&self, how: Shutdown) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.shutdown(how),
            Self::Unix(stream) => stream.shutdown(how),
        }
    }

    /// Sets the time limit of writes.
    pub fn set_write_timeout(&self, time: Duration) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.set_write_timeout(Some(time)),
            Self::Unix(stream) => stream.set_write_timeout(Some(time)),
        }
    }

    /// Sets the time limit of reads and writes.
    pub fn set_timeouts(&self, time: Duration) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => {
                stream.set_read_timeout(Some(time)).and_then(|()| stream.set_write_timeout(Some(time)))
            }
            Self::Unix(stream) => {
                stream.set_read_timeout(Some(time)).and_then(|()| stream.set_write_timeout(Some(time)))
            }
        }
    }
}

/// Connects to the first of the addresses that answers, with the time limit `limit` for each.
fn connect(address: &Address, limit: Duration) -> io::Result<DetectorStream> {
    let name = match address {
        Address::Unix(path) => return UnixStream::connect(path).map(DetectorStream::Unix),
        Address::Tcp(name) => name,
    };
    let mut failed = io::Error::new(io::ErrorKind::NotFound, "found no address of that host");
    for address in name.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, limit) {
            Ok(stream) => return Ok(DetectorStream::Tcp(stream)),
            Err(error) => failed = error,
        }
    }
    Err(failed)
}

impl Read for DetectorStream {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => stream.read(buffer),
            Self::Unix(stream) => stream.read(buffer),
        }
    }
}

impl Write for DetectorStream {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => stream.write(bytes),
            Self::Unix(stream) => stream.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.flush(),
            Self::Unix(stream) => stream.flush(),
        }
    }
}

/// A listening socket. The file of a Unix socket is removed with it.
pub enum Listener {
    Tcp(TcpListener),
    Unix(UnixListener, PathBuf),
}

impl Listener {
    /// Listens on `address` without blocking.
    pub fn bind(address: &Address) -> io::Result<Self> {
        Ok(match address {
            Address::Tcp(address) => {
                let listener = TcpListener::bind(address)?;
                listener.set_nonblocking(true)?;
                Self::Tcp(listener)
            }
            Address::Unix(path) => {
                let listener = UnixListener::bind(path)?;
                listener.set_nonblocking(true)?;
                Self::Unix(listener, path.clone())
            }
        })
    }

    /// Returns the address that it listens on.
    pub fn address(&self) -> io::Result<Address> {
        Ok(match self {
            Self::Tcp(listener) => Address::Tcp(listener.local_addr()?.to_string()),
            Self::Unix(_, path) => Address::Unix(path.clone()),
        })
    }

    /// Accepts a waiting client.
    pub fn accept(&self) -> io::Result<DetectorStream> {
        Ok(match self {
            Self::Tcp(listener) => {
                let stream = listener.accept()?.0;
                stream.set_nonblocking(false)?;
                DetectorStream::Tcp(stream)
            }
            Self::Unix(listener, _) => {
                let stream = listener.accept()?.0;
                stream.set_nonblocking(false)?;
                DetectorStream::Unix(stream)
            }
        })
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        if let Self::Unix(_, path) = self {
            // Another process may have removed it.
            let _ = std::fs::remove_file(path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_as_they_are_shown() {
        for text in ["localhost:7000", "[::1]:7000", "unix:/tmp/detector"] {
            assert_eq!(text.parse::<Address>().expect("good").to_string(), text);
        }
        for text in ["", "unix:", "localhost", "localhost:", ":7000", "localhost:70000"] {
            assert!(text.parse::<Address>().expect_err("bad").contains("expected HOST:PORT or unix:PATH"), "{text}");
        }
    }
}
