//! Packets of a `SOCK_SEQPACKET` socket that carry one text each, and files.
//!
//! The system limits the size of a packet, to some 200 kB by default. A longer text is passed in an anonymous file, sealed
//! against changes, whose descriptor is in the packet. So the socket does not limit the length of a scenario.

use std::io::{self, IoSlice, IoSliceMut, Write};
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::fs::FileExt;

use rustix::fs::{MemfdFlags, SealFlags};
use rustix::io::Errno;
use rustix::net::{
    RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, ReturnFlags, SendAncillaryBuffer,
    SendAncillaryMessage, SendFlags,
};

/// Maximum size of a text in the packet itself, bytes.
pub const PACKET_LIMIT: usize = 128 * 1024;

/// Maximum size of a text in a file, bytes: a damaged or hostile peer must not exhaust the memory.
const FILE_LIMIT: u64 = 64 << 20;

/// Maximum number of files in a packet, including that of its text.
const FILES_MAX: usize = 5;

/// Text of a packet whose text is in its last file.
const IN_FILE: &[u8] = br#"{"InFile":{}}"#;

/// Text and files of a packet.
#[derive(Debug)]
pub struct Packet {
    pub text: Vec<u8>,
    /// The files, without that of the text.
    pub files: Vec<OwnedFd>,
}

/// Failure to receive a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PacketError {
    /// The system refused.
    #[error(transparent)]
    Io(#[from] Errno),
    /// The text exceeds the limit.
    #[error("the message is too long for a packet")]
    TooLong,
}

/// Sends a text, with at most four files.
///
/// # Errors
/// The error of the system.
pub fn send(socket: impl AsFd, text: &[u8], files: &[BorrowedFd<'_>], flags: SendFlags) -> Result<(), Errno> {
    let socket = socket.as_fd();
    if text.len() <= PACKET_LIMIT {
        return send_packet(socket, text, files, flags);
    }
    let file = sealed(text)?;
    let mut files = files.to_vec();
    files.push(file.as_fd());
    send_packet(socket, IN_FILE, &files, flags)
}

fn send_packet(
    socket: BorrowedFd<'_>,
    text: &[u8],
    files: &[BorrowedFd<'_>],
    flags: SendFlags,
) -> Result<(), Errno> {
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(FILES_MAX))];
    let mut ancillary = SendAncillaryBuffer::new(&mut space);
    if !files.is_empty() && !ancillary.push(SendAncillaryMessage::ScmRights(files)) {
        return Err(Errno::TOOBIG);
    }
    let text = [IoSlice::new(text)];
    rustix::io::retry_on_intr(|| rustix::net::sendmsg(socket, &text, &mut ancillary, flags))?;
    Ok(())
}

/// Receives a packet; an empty text means that the other end is closed.
///
/// # Errors
/// [`PacketError`].
pub fn receive(socket: impl AsFd, flags: RecvFlags) -> Result<Packet, PacketError> {
    let mut text = vec![0; PACKET_LIMIT];
    let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(FILES_MAX))];
    let mut ancillary = RecvAncillaryBuffer::new(&mut space);
    let received = rustix::io::retry_on_intr(|| {
        let mut parts = [IoSliceMut::new(&mut text)];
        let flags = flags | RecvFlags::CMSG_CLOEXEC;
        rustix::net::recvmsg(&socket, &mut parts, &mut ancillary, flags)
    })?;
    if received.flags.contains(ReturnFlags::TRUNC) {
        return Err(PacketError::TooLong);
    }
    text.truncate(received.bytes);
    let files = ancillary.drain().filter_map(|message| match message {
        RecvAncillaryMessage::ScmRights(files) => Some(files),
        _ => None,
    });
    let mut files: Vec<OwnedFd> = files.flatten().collect();
    if text == IN_FILE {
        let file = files.pop().ok_or(Errno::BADF)?;
        text = text_of(file)?;
    }
    Ok(Packet { text, files })
}

/// Writes a text to a file sealed against changes.
fn sealed(text: &[u8]) -> Result<OwnedFd, Errno> {
    let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
    let mut file = std::fs::File::from(rustix::fs::memfd_create("gerono-message", flags)?);
    file.write_all(text).map_err(|error| errno(&error))?;
    let seals = SealFlags::WRITE | SealFlags::SHRINK | SealFlags::GROW | SealFlags::SEAL;
    rustix::fs::fcntl_add_seals(&file, seals)?;
    Ok(file.into())
}

fn text_of(file: OwnedFd) -> Result<Vec<u8>, PacketError> {
    // Only anonymous files have seals. Other files of a peer are refused: reading them could block.
    let seals = rustix::fs::fcntl_get_seals(&file)?;
    if !seals.contains(SealFlags::WRITE | SealFlags::SHRINK) {
        return Err(Errno::PERM.into());
    }
    let file = std::fs::File::from(file);
    let bytes = file.metadata().map_err(|error| errno(&error))?.len();
    let length = usize::try_from(bytes).ok().filter(|_| bytes <= FILE_LIMIT);
    let mut text = vec![0; length.ok_or(PacketError::TooLong)?];
    file.read_exact_at(&mut text, 0).map_err(|error| errno(&error))?;
    Ok(text)
}

fn errno(error: &io::Error) -> Errno {
    Errno::from_io_error(error).unwrap_or(Errno::IO)
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Seek, SeekFrom};

    use rustix::net::{AddressFamily, SocketFlags, SocketType};

    use super::*;

    fn pair() -> (OwnedFd, OwnedFd) {
        rustix::net::socketpair(
            AddressFamily::UNIX,
            SocketType::SEQPACKET,
            SocketFlags::CLOEXEC,
            None,
        )
        .unwrap()
    }

    fn text(length: usize) -> Vec<u8> {
        (0..length).map(|place| b'a' + (place % 26) as u8).collect()
    }

    #[test]
    fn texts_of_any_length_and_files_beside_them_arrive() {
        let (mine, theirs) = pair();
        let file = sealed(b"beside").unwrap();
        for length in [1, PACKET_LIMIT, PACKET_LIMIT + 1, 3_000_000] {
            let sent = text(length);
            for files in [&[][..], &[file.as_fd(); 4]] {
                send(&mine, &sent, files, SendFlags::NOSIGNAL).unwrap();
                let received = receive(&theirs, RecvFlags::empty()).unwrap();
                assert!(received.text == sent, "{length}");
                assert_eq!(received.files.len(), files.len());
            }
        }
        drop(mine);
        assert!(receive(&theirs, RecvFlags::empty()).unwrap().text.is_empty());
    }

    #[test]
    fn a_packet_that_does_not_fit_is_too_long_and_the_next_one_arrives() {
        let (mine, theirs) = pair();
        rustix::net::send(&mine, &text(PACKET_LIMIT + 1), SendFlags::NOSIGNAL).unwrap();
        send(&mine, b"next", &[], SendFlags::NOSIGNAL).unwrap();
        assert!(matches!(
            receive(&theirs, RecvFlags::empty()),
            Err(PacketError::TooLong)
        ));
        assert_eq!(receive(&theirs, RecvFlags::empty()).unwrap().text, b"next");
    }

    #[test]
    fn a_file_that_can_still_change_or_may_block_is_not_read() {
        let (mine, theirs) = pair();
        let open = rustix::fs::memfd_create("open", MemfdFlags::ALLOW_SEALING).unwrap();
        let (pipe, _writer) = rustix::pipe::pipe().unwrap();
        let huge = rustix::fs::memfd_create("huge", MemfdFlags::ALLOW_SEALING).unwrap();
        rustix::fs::ftruncate(&huge, FILE_LIMIT + 1).unwrap();
        rustix::fs::fcntl_add_seals(&huge, SealFlags::WRITE | SealFlags::SHRINK).unwrap();
        for file in [&open, &pipe, &huge] {
            send_packet(mine.as_fd(), IN_FILE, &[file.as_fd()], SendFlags::NOSIGNAL).unwrap();
            assert!(receive(&theirs, RecvFlags::empty()).is_err());
        }
        send_packet(mine.as_fd(), IN_FILE, &[], SendFlags::NOSIGNAL).unwrap();
        assert!(receive(&theirs, RecvFlags::empty()).is_err());
    }

    #[test]
    fn a_text_in_a_file_is_whole_whatever_was_read_of_it() {
        let (mine, theirs) = pair();
        let sent = text(PACKET_LIMIT + 5);
        let mut file = std::fs::File::from(sealed(&sent).unwrap());
        file.seek(SeekFrom::Start(10)).unwrap();
        file.read_exact(&mut [0; 100]).unwrap();
        send_packet(mine.as_fd(), IN_FILE, &[file.as_fd()], SendFlags::NOSIGNAL).unwrap();
        assert!(receive(&theirs, RecvFlags::empty()).unwrap().text == sent);
    }
}
