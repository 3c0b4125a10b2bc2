//! Identity of the program that flies: results of two builds may differ in their bits.

use std::fs::File;
use std::io::{self, Read};
use std::path::PathBuf;

use sha2::{Digest, Sha256};
use shared_types::sample::hex;

/// Returns the SHA-256 of the build that flies, in hexadecimal: of the file that this code was loaded from, which is the
/// program, or the module of an interpreter.
///
/// # Errors
/// If the file cannot be read.
pub fn program_hash() -> io::Result<String> {
    let mut program = File::open(mapped_file(program_hash as fn() -> io::Result<String> as usize)?)?;
    let (mut hash, mut part) = (Sha256::new(), vec![0; 1 << 16]);
    loop {
        match program.read(&mut part)? {
            0 => return Ok(hex(&hash.finalize())),
            count => hash.update(&part[..count]),
        }
    }
}

/// Returns the file that is mapped at an address of this process.
fn mapped_file(address: usize) -> io::Result<PathBuf> {
    let maps = std::fs::read_to_string("/proc/self/maps")?;
    let path = maps.lines().find_map(|line| {
        let (range, rest) = line.split_once(' ')?;
        let (from, to) = range.split_once('-')?;
        let limit = |text| usize::from_str_radix(text, 16).ok();
        let path = &rest[rest.find('/')?..];
        (limit(from)?..limit(to)?)
            .contains(&address)
            .then(|| path.to_owned())
    });
    let path = path.ok_or_else(|| io::Error::other("no file is mapped where this program is"))?;
    let own = PathBuf::from("/proc/self/exe");
    // The link leads to the program also after its file was replaced.
    let is_program = std::fs::read_link(&own).is_ok_and(|target| target.as_os_str() == path.as_str());
    Ok(if is_program { own } else { path.into() })
}
