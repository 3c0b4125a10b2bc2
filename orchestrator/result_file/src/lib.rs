//! Atomic writing of result files.
//!
//! A file is written without a name in the folder of its target, and named when it is complete and on the disk. Until
//! then the target stays as it is, so a failed command, a full disk or a killed process costs no earlier result and
//! leaves nothing behind. On a file system without unnamed files, such as NFS, the file has a temporary name, which a
//! killed process leaves. A file that the command reads is refused as a target. Files are compared by inode, so other
//! names, links and spellings of the path are recognised. A file that begins unlike the result is no earlier result of the
//! same command, and is refused as well: it may be the log of another flight, or a scenario.
//!
//! A symbolic link at the target is replaced, not followed: in a folder that other users can write, they choose where
//! it leads. A device, a FIFO or an open descriptor (`/dev/stdout`) cannot be replaced and is written directly.
//!
//! clippy.toml forbids every other way to create, empty or overwrite a file.

use std::fs::{self, File, Permissions};
use std::io::{self, Write};
use std::os::fd::{AsFd, AsRawFd};
use std::os::unix::fs::{FileExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use rustix::fs::{Access, AtFlags, CWD, Mode, OFlags, RenameFlags, access, linkat, openat, renameat_with};
use rustix::io::Errno;

/// Maximum number of bytes that tell the kind of a file.
const HEAD: usize = 64;

/// Result file being written. If it is dropped before [`Self::finish`], nothing of it remains.
#[derive(Debug)]
pub struct ResultFile {
    file: File,
    /// `None` if the target is written directly.
    rename: Option<Rename>,
}

/// Pending rename of a finished file.
#[derive(Debug)]
struct Rename {
    /// `None` while the file has no name.
    temporary: Option<PathBuf>,
    target: PathBuf,
    replaces: bool,
}

impl ResultFile {
    /// Creates the file `target`; on [`Self::finish`] it replaces a file of that name and kind. `inputs` are all files that
    /// are read for it.
    ///
    /// # Errors
    /// The system's error, or that `target` is one of the inputs.
    pub fn create(target: &Path, inputs: &[PathBuf]) -> io::Result<Self> {
        if is_one_of(target, inputs) {
            let reason = "this command reads it and does not overwrite it; name another file";
            return Err(io::Error::new(io::ErrorKind::InvalidInput, reason));
        }
        match written_directly(target)? {
            Some(file) => Ok(Self { file, rename: None }),
            None => Self::begin(target, true),
        }
    }

    /// Creates the file `target`, which must not exist now or on [`Self::finish`].
    ///
    /// # Errors
    /// The system's error.
    pub fn create_new(target: &Path) -> io::Result<Self> {
        if fs::symlink_metadata(target).is_ok() {
            return Err(taken("it exists already"));
        }
        Self::begin(target, false)
    }

    fn begin(target: &Path, replaces: bool) -> io::Result<Self> {
        let folder = folder_of(target);
        let (temporary, file) = match unnamed_file(folder) {
            Some(file) => (None, file),
            None => with_new_name(folder, new_file).map(|(name, file)| (Some(name), file))?,
        };
        let rename = Some(Rename {
            temporary,
            target: target.to_owned(),
            replaces,
        });
        let result = Self { file, rename };
        copy_permissions(target, &result.file)?;
        Ok(result)
    }

    /// Returns another descriptor of the file, for a writer that owns one.
    ///
    /// # Errors
    /// If no descriptor is left.
    pub fn try_clone(&self) -> io::Result<File> {
        self.file.try_clone()
    }

    /// Returns the number of bytes written so far.
    ///
    /// # Errors
    /// The system's error.
    pub fn bytes(&self) -> io::Result<u64> {
        Ok(self.file.metadata()?.len())
    }

    /// Renames the file to its target. The data are synchronised to the disk first: otherwise a power failure after the
    /// rename could leave an empty file under the target's name.
    ///
    /// # Errors
    /// The system's error, or that a file of another kind has the name; the target is unchanged then.
    pub fn finish(mut self) -> io::Result<()> {
        let Some(rename) = &mut self.rename else {
            return self.file.flush();
        };
        if rename.replaces && !may_replace(&rename.target, &self.file)? {
            return Err(taken("it holds something else"));
        }
        self.file.sync_all()?;
        rename.execute(&self.file)?;
        self.rename = None;
        Ok(())
    }
}

impl Write for ResultFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Drop for ResultFile {
    fn drop(&mut self) {
        if let Some(temporary) = self.rename.as_ref().and_then(|rename| rename.temporary.as_ref()) {
            // This process created it, under a name that no other file had.
            let _ = fs::remove_file(temporary);
        }
    }
}

impl Rename {
    fn execute(&mut self, file: &File) -> io::Result<()> {
        let Self {
            temporary,
            target,
            replaces,
        } = self;
        let target: &Path = target;
        let temporary: &Path = match temporary {
            Some(name) => name,
            // No call links a file in place of another one.
            None => temporary.insert(with_new_name(folder_of(target), |name| link(file, name))?.0),
        };
        if *replaces {
            return fs::rename(temporary, target);
        }
        match renameat_with(CWD, temporary, CWD, target, RenameFlags::NOREPLACE) {
            // Not supported by the file system, such as NFS.
            Err(Errno::INVAL | Errno::NOSYS) => {
                fs::hard_link(temporary, target)?;
                // The result has its name; a leftover temporary name is no reason to fail.
                let _ = fs::remove_file(temporary);
                Ok(())
            }
            result => Ok(result?),
        }
    }
}

/// Writes a result file. `inputs` are all files that were read for it.
///
/// # Errors
/// As [`ResultFile::create`].
pub fn write(target: &Path, bytes: impl AsRef<[u8]>, inputs: &[PathBuf]) -> io::Result<()> {
    let mut file = ResultFile::create(target, inputs)?;
    file.write_all(bytes.as_ref())?;
    file.finish()
}

/// Returns whether a path leads to one of these files, under any name.
#[must_use]
pub fn is_one_of(path: &Path, files: &[PathBuf]) -> bool {
    let identity = |path: &Path| {
        let found = fs::metadata(path).ok().filter(fs::Metadata::is_file)?;
        Some((found.dev(), found.ino()))
    };
    let own = identity(path);
    own.is_some() && files.iter().any(|file| identity(file) == own)
}

fn taken(because: &str) -> io::Error {
    let reason = format!("{because} and is not overwritten; name another file, or remove it");
    io::Error::new(io::ErrorKind::AlreadyExists, reason)
}

/// Returns whether a result may replace its target: a link, an empty file, or a file of the same kind.
fn may_replace(target: &Path, result: &File) -> io::Result<bool> {
    let replaced = fs::symlink_metadata(target).is_ok_and(|found| found.is_file() && found.len() > 0);
    Ok(!replaced || kind(&head(&File::open(target)?)?) == kind(&head(result)?))
}

/// Returns the first bytes of a file.
fn head(file: &File) -> io::Result<Vec<u8>> {
    let mut head = Vec::new();
    let mut buffer = [0; HEAD];
    while head.len() < HEAD {
        let count = file.read_at(&mut buffer[head.len()..], head.len() as u64)?;
        if count == 0 {
            break;
        }
        head.extend_from_slice(&buffer[head.len()..][..count]);
    }
    Ok(head)
}

/// Returns the part of a file's first bytes that tells its kind: up to the end of the first word, such as `<svg` or
/// `{ "rates`. In an MCAP file it is the first word of the header: the profile of a log, which copies for viewers lack.
fn kind(head: &[u8]) -> &[u8] {
    // The magic, and the code and length of the header.
    let before = if head.starts_with(b"\x89MCAP0\r\n") { 17 } else { 0 };
    let is_letter = |byte: &u8| byte.is_ascii_alphabetic();
    let bytes = head.iter().skip(before);
    let word = before + bytes.clone().take_while(|byte| !is_letter(byte)).count();
    let letters = head.iter().skip(word).take_while(|byte| is_letter(byte)).count();
    &head[..head.len().min(word + letters)]
}

/// Creates a file that did not exist.
///
/// # Errors
/// The system's error.
#[expect(
    clippy::disallowed_methods,
    reason = "a file is created here, and nothing else is"
)]
pub fn new_file(path: &Path) -> io::Result<File> {
    File::options().read(true).write(true).create_new(true).open(path)
}

/// Opens a regular file, without waiting for the other end of a FIFO, and unless it `follows` links without following one at
/// the name.
///
/// # Errors
/// [`io::ErrorKind::InvalidInput`] if it is no regular file, or the system's error.
pub fn open_regular(path: &Path, options: &mut fs::OpenOptions, follows: bool) -> io::Result<File> {
    let flags = if follows {
        OFlags::NONBLOCK
    } else {
        OFlags::NONBLOCK | OFlags::NOFOLLOW
    };
    let refused = |reason: &str| io::Error::new(io::ErrorKind::InvalidInput, reason);
    match options.custom_flags(flags.bits().cast_signed()).open(path) {
        Ok(file) if file.metadata()?.is_file() => Ok(file),
        Ok(_) => Err(refused("it is no regular file")),
        Err(error) if error.raw_os_error() == Some(Errno::LOOP.raw_os_error()) => {
            Err(refused("it is a symbolic link"))
        }
        Err(error) => Err(error),
    }
}

/// Creates a file without a name in a folder, for data that are read again before the process ends.
///
/// # Errors
/// The system's error.
pub fn scratch_file(folder: &Path) -> io::Result<File> {
    if let Some(file) = unnamed_file(folder) {
        return Ok(file);
    }
    let (name, file) = with_new_name(folder, new_file)?;
    fs::remove_file(name)?;
    Ok(file)
}

/// Returns the path by which this process opens its own file, which needs no name.
#[must_use]
pub fn descriptor_path(file: &File) -> PathBuf {
    Path::new("/proc/self/fd").join(file.as_raw_fd().to_string())
}

/// Creates a file without a name that can get one. `None` if the system has no such files here.
fn unnamed_file(folder: &Path) -> Option<File> {
    let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
    let file = File::from(openat(CWD, folder, flags, Mode::from_raw_mode(0o666)).ok()?);
    // The name is given through `/proc`, which a container may lack.
    descriptor_path(&file).exists().then_some(file)
}

/// Gives an unnamed file a name that no other file has.
fn link(file: &File, name: &Path) -> io::Result<()> {
    Ok(linkat(
        CWD,
        descriptor_path(file),
        CWD,
        name,
        AtFlags::SYMLINK_FOLLOW,
    )?)
}

/// Creates something under a temporary name in a folder.
fn with_new_name<T>(folder: &Path, create: impl Fn(&Path) -> io::Result<T>) -> io::Result<(PathBuf, T)> {
    loop {
        let name = folder.join(next_name());
        match create(&name) {
            // Left by an earlier process with the same PID. It is not ours, so it stays.
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            created => return Ok((name, created?)),
        }
    }
}

/// Opens a target that cannot be replaced: a device, a FIFO, or a descriptor of this process.
fn written_directly(target: &Path) -> io::Result<Option<File>> {
    // Its descriptor is duplicated, with offset and flags: opened by name, a regular file would be written from its
    // start.
    if target == Path::new("/dev/stdout") {
        return duplicate(&io::stdout()).map(Some);
    }
    if target == Path::new("/dev/stderr") {
        return duplicate(&io::stderr()).map(Some);
    }
    let Ok(found) = fs::metadata(target) else {
        return Ok(None);
    };
    if found.is_dir() {
        return Err(io::ErrorKind::IsADirectory.into());
    }
    let is_descriptor = folder_of(target)
        .canonicalize()
        .is_ok_and(|folder| folder.starts_with("/proc"));
    if found.is_file() && !is_descriptor {
        return Ok(None);
    }
    File::options().append(true).open(target).map(Some)
}

/// Copies the permissions of the file that will be replaced, which may restrict readers. Fails if that file is not
/// writable.
fn copy_permissions(target: &Path, file: &File) -> io::Result<()> {
    match fs::symlink_metadata(target) {
        Ok(found) if found.is_file() => {
            access(target, Access::WRITE_OK)?;
            file.set_permissions(Permissions::from_mode(found.mode() & 0o777))
        }
        _ => Ok(()),
    }
}

fn duplicate(stream: &impl AsFd) -> io::Result<File> {
    Ok(File::from(stream.as_fd().try_clone_to_owned()?))
}

fn folder_of(path: &Path) -> &Path {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
}

/// Returns a temporary name that this process has not used yet.
fn next_name() -> String {
    static NUMBER: AtomicU64 = AtomicU64::new(0);
    let number = NUMBER.fetch_add(1, Ordering::Relaxed);
    format!(".gerono-{}-{number}.tmp", std::process::id())
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make their own files")]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    /// Names in a folder, sorted.
    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<_> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn a_result_replaces_the_earlier_one_only_when_it_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("plot.svg");
        write(&target, "<svg 1>", &[]).unwrap();
        let mut second = ResultFile::create(&target, &[]).unwrap();
        second.write_all(b"<svg 2>").unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"<svg 1>");
        drop(second);
        assert_eq!(fs::read(&target).unwrap(), b"<svg 1>");
        assert_eq!(names(folder.path()), ["plot.svg"]);
        write(&target, "<svg 3>", &[]).unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"<svg 3>");
        fs::set_permissions(&target, Permissions::from_mode(0o640)).unwrap();
        write(&target, "<svg 4>", &[]).unwrap();
        assert_eq!(fs::metadata(&target).unwrap().mode() & 0o777, 0o640);
        assert_eq!(names(folder.path()), ["plot.svg"]);
    }

    #[test]
    fn a_file_that_is_read_is_no_target_by_any_of_its_names() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::write(path("log"), "flight").unwrap();
        fs::write(path("other"), "other").unwrap();
        symlink("log", path("link")).unwrap();
        fs::hard_link(path("log"), path("hard")).unwrap();
        let inputs = [path("other"), path("log")];
        for name in ["log", "link", "hard", "./log", "other"] {
            let refused = write(&path(name), "new", &inputs).unwrap_err();
            assert_eq!(refused.kind(), io::ErrorKind::InvalidInput, "{name}: {refused}");
        }
        let through_another_folder = path("..").join(folder.path().file_name().unwrap()).join("log");
        assert!(write(&through_another_folder, "new", &inputs).is_err());
        assert_eq!(fs::read(path("log")).unwrap(), b"flight");
        assert_eq!(names(folder.path()), ["hard", "link", "log", "other"]);
    }

    /// First bytes of an MCAP file with a profile, and its content.
    fn mcap(profile: &str, content: &str) -> Vec<u8> {
        let header: Vec<u8> = [profile, "gerono"]
            .iter()
            .flat_map(|text| [&u32::try_from(text.len()).unwrap().to_le_bytes(), text.as_bytes()].concat())
            .collect();
        let length = (header.len() as u64).to_le_bytes();
        [b"\x89MCAP0\r\n\x01", &length[..], &header, content.as_bytes()].concat()
    }

    #[test]
    fn a_result_replaces_only_a_file_of_its_kind() {
        let folder = tempfile::tempdir().unwrap();
        let contents = [
            mcap("ros2", "1 flight"),
            mcap("", "1 view"),
            b"# Fig. 1\n[schedule]\ntick = 0.001\n".to_vec(),
            b"[schedule]\ntick = 0.001\n".to_vec(),
            b"{\n  \"scenario\": \"fig1\"\n}".to_vec(),
            b"{\n  \"rates\": []\n}".to_vec(),
            b"header.tick,header.stamp_ns\n0,0\n".to_vec(),
            b"{\"topic\":\"vehicle/truth\"}\n".to_vec(),
            b"<svg xmlns".to_vec(),
            b"0.5, 1.5\n".to_vec(),
        ];
        for (index, old) in contents.iter().enumerate() {
            // Numbers alone are no result.
            for (other, new) in contents.iter().enumerate().take(contents.len() - 1) {
                let target = folder.path().join(format!("{index}-{other}"));
                fs::write(&target, old).unwrap();
                let result = [new, &b" again"[..]].concat();
                let written = write(&target, &result, &[]);
                if index == other {
                    written.unwrap();
                    assert_eq!(fs::read(&target).unwrap(), result);
                } else {
                    let refused = written.unwrap_err();
                    assert!(refused.to_string().contains("name another file"), "{refused}");
                    assert_eq!(&fs::read(&target).unwrap(), old);
                }
            }
        }
        let empty = folder.path().join("empty");
        fs::write(&empty, "").unwrap();
        write(&empty, &contents[0], &[]).unwrap();
        assert!(write(&empty, "", &[]).is_err(), "an empty result is of no kind");
        assert_eq!(
            names(folder.path()).len(),
            contents.len() * (contents.len() - 1) + 1
        );
    }

    #[test]
    fn a_symbolic_link_is_replaced_and_what_it_leads_to_stays() {
        let folder = tempfile::tempdir().unwrap();
        let [log, link, dangling] = ["log", "link", "dangling"].map(|name| folder.path().join(name));
        fs::write(&log, "flight").unwrap();
        symlink(&log, &link).unwrap();
        symlink("nowhere", &dangling).unwrap();
        for target in [&link, &dangling] {
            write(target, "plot", &[]).unwrap();
            assert!(target.symlink_metadata().unwrap().is_file());
            assert_eq!(fs::read(target).unwrap(), b"plot");
        }
        assert_eq!(fs::read(&log).unwrap(), b"flight");
    }

    #[test]
    fn a_new_file_takes_nobodys_place() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("saved.mcap");
        let mut file = ResultFile::create_new(&target).unwrap();
        file.write_all(b"recovered").unwrap();
        // Something gets the name meanwhile.
        fs::write(&target, "mine").unwrap();
        assert_eq!(file.finish().unwrap_err().kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(fs::read(&target).unwrap(), b"mine");
        assert_eq!(names(folder.path()), ["saved.mcap"]);
        symlink("nowhere", folder.path().join("link")).unwrap();
        let refused = ResultFile::create_new(&folder.path().join("link")).unwrap_err();
        assert_eq!(refused.kind(), io::ErrorKind::AlreadyExists);
    }

    #[test]
    fn a_killed_process_leaves_nothing_and_a_file_with_a_temporary_name_is_written_alike() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("plot.svg");
        fs::write(&target, "plot first").unwrap();
        assert!(
            unnamed_file(folder.path()).is_some(),
            "folders of tests have unnamed files"
        );
        let mut killed = ResultFile::create(&target, &[]).unwrap();
        killed.write_all(b"plot second").unwrap();
        let scratch = scratch_file(folder.path()).unwrap();
        fs::write(descriptor_path(&scratch), "log").unwrap();
        assert_eq!(fs::read(descriptor_path(&scratch)).unwrap(), b"log");
        assert_eq!(names(folder.path()), ["plot.svg"]);
        std::mem::forget(killed);

        for (replaces, kind) in [(true, None), (false, Some(io::ErrorKind::AlreadyExists))] {
            let (temporary, file) = with_new_name(folder.path(), new_file).unwrap();
            let rename = Rename {
                temporary: Some(temporary),
                target: target.clone(),
                replaces,
            };
            let mut result = ResultFile {
                file,
                rename: Some(rename),
            };
            result.write_all(b"plot third").unwrap();
            assert_eq!(names(folder.path()).len(), 2);
            assert_eq!(result.finish().err().map(|error| error.kind()), kind);
            assert_eq!(fs::read(&target).unwrap(), b"plot third");
            assert_eq!(names(folder.path()), ["plot.svg"]);
        }
    }

    #[test]
    fn a_temporary_name_that_is_taken_stays_and_another_is_found() {
        let folder = tempfile::tempdir().unwrap();
        // As an earlier process of this number would have left them; other tests count, too.
        let left: Vec<_> = (0..500)
            .map(|number| {
                folder
                    .path()
                    .join(format!(".gerono-{}-{number}.tmp", std::process::id()))
            })
            .collect();
        for name in &left {
            fs::write(name, "left").unwrap();
        }
        write(&folder.path().join("a"), "new", &[]).unwrap();
        assert_eq!(fs::read(folder.path().join("a")).unwrap(), b"new");
        assert!(left.iter().all(|name| fs::read(name).unwrap() == b"left"));
    }

    #[test]
    fn devices_and_descriptors_are_written_and_not_replaced() {
        write(Path::new("/dev/null"), "nothing", &[]).unwrap();
        assert!(!fs::metadata("/dev/null").unwrap().is_file());
        let full = write(Path::new("/dev/full"), "much", &[]).unwrap_err();
        assert_eq!(full.kind(), io::ErrorKind::StorageFull);
        // What a shell opens for `>>`: the text before stays.
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("text");
        fs::write(&path, "before ").unwrap();
        let open = File::options().append(true).open(&path).unwrap();
        let descriptor = std::os::fd::AsRawFd::as_raw_fd(&open);
        for name in [
            format!("/dev/fd/{descriptor}"),
            format!("/proc/self/fd/{descriptor}"),
        ] {
            write(Path::new(&name), "after ", &[]).unwrap();
        }
        assert_eq!(fs::read(&path).unwrap(), b"before after after ");
    }

    #[test]
    fn what_cannot_be_written_is_an_error_that_changes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let missing = write(&folder.path().join("no/such/file"), "", &[]).unwrap_err();
        assert_eq!(missing.kind(), io::ErrorKind::NotFound);
        let place = write(folder.path(), "", &[]).unwrap_err();
        assert_eq!(place.kind(), io::ErrorKind::IsADirectory);
        assert!(names(folder.path()).is_empty());
    }
}
