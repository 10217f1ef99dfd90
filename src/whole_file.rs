//! Files that are written in full or not at all.

use std::{
    fs::{self, File, OpenOptions},
    hash::{BuildHasher, RandomState},
    io::{self, Write},
    path::{Path, PathBuf},
};

/// Writes a file under a temporary name and renames it when it is complete. Until then an existing file stays as it is.
///
/// # Errors
/// The error of the file system.
pub fn write(path: &Path, content: &[u8]) -> io::Result<()> {
    Staged::new(path, content)?.commit()
}

/// Tests whether a file can be written, without a change. Devices and pipes are not opened, because that may wait for a reader.
///
/// # Errors
/// The error of the file system.
pub fn check(path: &Path) -> io::Result<()> {
    match Target::of(path)? {
        Target::Stream(_) => Ok(()),
        Target::File { path, existing } => {
            if existing.is_some() {
                OpenOptions::new().write(true).open(&path)?;
            }
            let temporary = temporary(&path);
            File::create_new(&temporary)?;
            fs::remove_file(temporary)
        }
    }
}

/// The content of a file, complete under a temporary name in the same folder. Without [`commit`](Self::commit) it is removed.
#[derive(Debug)]
pub struct Staged {
    /// The temporary file. `None` for a device or pipe.
    temporary: Option<PathBuf>,
    target: PathBuf,
    /// The content for a device or pipe.
    content: Vec<u8>,
}

impl Staged {
    /// Writes the temporary file. It has the mode of the file that it replaces. Devices and pipes get their content later.
    ///
    /// # Errors
    /// The error of the file system.
    pub fn new(path: &Path, content: &[u8]) -> io::Result<Self> {
        let (target, existing) = match Target::of(path)? {
            Target::Stream(target) => return Ok(Self { temporary: None, target, content: content.into() }),
            Target::File { path, existing } => (path, existing),
        };
        let staged = Self { temporary: Some(temporary(&target)), target, content: vec![] };
        if let Some(temporary) = &staged.temporary {
            let mut file = File::create_new(temporary)?;
            if let Some(permissions) = existing {
                file.set_permissions(permissions)?;
            }
            file.write_all(content)?;
        }
        Ok(staged)
    }

    /// Returns true if a rename replaces the destination.
    pub fn is_file(&self) -> bool {
        self.temporary.is_some()
    }

    /// Renames the temporary file, or writes to the device or pipe.
    ///
    /// # Errors
    /// The error of the file system.
    pub fn commit(mut self) -> io::Result<()> {
        match &self.temporary {
            Some(temporary) => fs::rename(temporary, &self.target)?,
            None => OpenOptions::new().write(true).open(&self.target)?.write_all(&self.content)?,
        }
        self.temporary = None;
        Ok(())
    }
}

impl Drop for Staged {
    fn drop(&mut self) {
        if let Some(temporary) = &self.temporary {
            // If this fails too, the temporary file stays, which does no harm.
            let _ = fs::remove_file(temporary);
        }
    }
}

/// A destination, after symbolic links.
enum Target {
    /// A device or a pipe, which cannot be replaced.
    Stream(PathBuf),
    /// A file, and the permissions of an existing one.
    File { path: PathBuf, existing: Option<fs::Permissions> },
}

impl Target {
    fn of(path: &Path) -> io::Result<Self> {
        match fs::metadata(path) {
            Ok(metadata) if metadata.is_dir() => Err(io::ErrorKind::IsADirectory.into()),
            Ok(metadata) if !metadata.is_file() => Ok(Self::Stream(path.into())),
            // A rename would replace what the shell has opened, with the content before the end.
            Ok(_) if path.starts_with("/dev") => Err(io::Error::other("it leads to a file; name that file")),
            Ok(metadata) => Ok(Self::File { path: fs::canonicalize(path)?, existing: Some(metadata.permissions()) }),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                // A link may lead to a file that does not exist yet. Such links form no loop, which would be another error.
                let mut path = path.to_owned();
                while let Ok(to) = fs::read_link(&path) {
                    path = path.parent().unwrap_or(Path::new("")).join(to);
                }
                Ok(Self::File { path, existing: None })
            }
            Err(error) => Err(error),
        }
    }
}

/// A path in the same folder. The random hash makes the name unique, even if another machine writes to the same folder. The length of the name does not
/// depend on that of the file.
fn temporary(path: &Path) -> PathBuf {
    path.with_file_name(format!(".{:016x}.tmp", RandomState::new().hash_one(path)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An empty folder.
    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("bevy_medial-whole_file-{name}-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        folder
    }

    fn names(folder: &Path) -> Vec<String> {
        let names = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let mut names: Vec<_> = names.collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_is_replaced_and_one_that_cannot_be_written_leaves_nothing() {
        let folder = folder("replaced");
        fs::create_dir_all(folder.join("a folder")).unwrap();
        let path = folder.join("one");
        for content in ["first", "second"] {
            check(&path).unwrap();
            write(&path, content.as_bytes()).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), content);
        }
        for blocked in ["a folder", "no folder/file", &"n".repeat(256)] {
            assert!(
                check(&folder.join(blocked)).is_err() && write(&folder.join(blocked), b"third").is_err(),
                "{blocked}"
            );
        }
        // The check leaves no file, and a staged file goes without a commit.
        check(&folder.join("two")).unwrap();
        let staged = Staged::new(&path, b"third").unwrap();
        assert_eq!((names(&folder).len(), fs::read_to_string(&path).unwrap()), (3, "second".into()));
        drop(staged);
        assert_eq!(names(&folder), ["a folder", "one"]);
        let longest = folder.join("n".repeat(255));
        write(&longest, b"fourth").unwrap();
        assert_eq!(fs::read_to_string(&longest).unwrap(), "fourth");
        fs::remove_dir_all(folder).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_and_modes_kept() {
        use std::os::unix::fs::{PermissionsExt, symlink};

        let folder = folder("links");
        fs::create_dir_all(folder.join("other")).unwrap();
        let [file, link, second, dangling] = ["other/file", "link", "second", "dangling"].map(|name| folder.join(name));
        fs::write(&file, "before").unwrap();
        fs::set_permissions(&file, fs::Permissions::from_mode(0o640)).unwrap();
        symlink("other/file", &link).unwrap();
        symlink("link", &second).unwrap();
        symlink("other/new", &dangling).unwrap();
        for (path, target, mode) in [(&second, &file, Some(0o640)), (&dangling, &folder.join("other/new"), None)] {
            check(path).unwrap();
            write(path, b"after").unwrap();
            assert!(fs::symlink_metadata(path).unwrap().is_symlink());
            assert_eq!(fs::read_to_string(target).unwrap(), "after");
            let found = fs::metadata(target).unwrap().permissions().mode() & 0o7777;
            assert_eq!(found, mode.unwrap_or(found));
        }
        assert_eq!((names(&folder).len(), names(&folder.join("other")).len()), (4, 2));
        symlink("round", folder.join("round")).unwrap();
        assert!(check(&folder.join("round")).is_err() && write(&folder.join("round"), b"").is_err());
        fs::remove_dir_all(folder).unwrap();
    }
}
