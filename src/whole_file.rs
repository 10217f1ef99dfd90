//! Atomic replacement of files.

use std::{
    fs,
    hash::{BuildHasher, RandomState},
    io,
    path::Path,
};

/// Writes a file under a temporary name and renames it when it is complete. Until then an existing file stays as it is.
pub(crate) fn write(path: &Path, content: &[u8]) -> io::Result<()> {
    // The random hash makes the name unique, even if another machine writes to the same folder.
    let temporary = path.with_extension(format!("{:016x}.tmp", RandomState::new().hash_one(path)));
    fs::write(&temporary, content).and_then(|()| fs::rename(&temporary, path)).inspect_err(|_| {
        // If this fails too, the temporary file stays, which does no harm.
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
