//! Files of which nobody sees a part.

use std::{
    fs,
    hash::{BuildHasher, RandomState},
    io,
    path::Path,
};

/// Writes a file, which gets its name when it is whole: until then what was there before is there.
pub(crate) fn write(path: &Path, content: &[u8]) -> io::Result<()> {
    // Nobody else writes one of that name, on whatever machine.
    let temporary = path.with_extension(format!("{:016x}.tmp", RandomState::new().hash_one(path)));
    fs::write(&temporary, content).and_then(|()| fs::rename(&temporary, path)).inspect_err(|_| {
        // What is left of it does no harm if this fails too.
        let _ = fs::remove_file(&temporary);
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_and_one_that_cannot_be_written_leaves_nothing() {
        let folder = std::env::temp_dir().join(format!("bevy_medial-whole_file-{}", std::process::id()));
        fs::create_dir_all(folder.join("a folder")).unwrap();
        let path = folder.join("one");
        for content in ["first", "second"] {
            write(&path, content.as_bytes()).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), content);
        }
        assert!(write(&folder.join("a folder"), b"third").is_err());
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 2);
        fs::remove_dir_all(folder).unwrap();
    }
}
