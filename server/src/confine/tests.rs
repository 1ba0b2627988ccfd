//! Files and calls are a thread's, so each test gives up the rights of a thread of its own.

use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::Command;

use super::{Rights, calls, files};

/// Runs `work` on a thread with no rights but these.
fn confined(rights: Rights, work: impl FnOnce() + Send + 'static) {
    let thread = std::thread::spawn(move || {
        files::restrict(&rights).expect("a system with Landlock");
        calls::refuse(rights.network).expect("a system with seccomp");
        work();
    });
    if let Err(panic) = thread.join() {
        std::panic::resume_unwind(panic);
    }
}

fn refused<T: std::fmt::Debug>(done: std::io::Result<T>) {
    let error = done.expect_err("a right that is gone");
    assert_eq!(error.kind(), ErrorKind::PermissionDenied, "{error}");
}

#[test]
fn named_folders_stay_and_no_other_file_is_opened_made_or_removed() {
    let folder = tempfile::tempdir().expect("a folder");
    let root = folder.path().to_owned();
    for name in ["read", "write", "other"] {
        fs::create_dir(root.join(name)).expect("makes");
        fs::write(root.join(name).join("file"), name).expect("writes");
    }
    let rights = Rights {
        read: vec![root.join("read")],
        write: vec![root.join("write")],
        ..Rights::default()
    };
    confined(rights, move || {
        let at = |path: &str| root.join(path);
        assert_eq!(fs::read_to_string(at("read/file")).expect("reads"), "read");
        refused(fs::write(at("read/file"), "x"));
        refused(fs::remove_file(at("read/file")));
        refused(File::create(at("read/new")));
        refused(fs::read(at("other/file")));
        refused(fs::write(at("other/file"), "x"));
        refused(fs::remove_file(at("other/file")));
        refused(fs::create_dir(at("other/new")));
        refused(fs::read_dir(&root));
        for path in ["/etc/passwd", "/proc/1/environ", "/"] {
            refused(File::open(Path::new(path)));
        }
        let mut file = File::create(at("write/new")).expect("makes");
        file.write_all(b"all").expect("writes");
        fs::rename(at("write/new"), at("write/file")).expect("renames");
        assert_eq!(fs::read(at("write/file")).expect("reads"), b"all");
        refused(std::os::unix::fs::symlink("/", at("write/link")));
        assert!(fs::rename(at("write/file"), at("other/file")).is_err());
        assert!(fs::hard_link(at("other/file"), at("write/link")).is_err());
        // A thread that starts later has no more.
        let later = std::thread::spawn(|| File::open("/etc/passwd").is_err());
        assert!(later.join().expect("no panic"));
    });
}

#[test]
fn sockets_programs_and_other_processes_are_out_of_reach() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("listens");
    let address = listener.local_addr().expect("an address");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("socket");
    let _listens = std::os::unix::net::UnixListener::bind(&path).expect("listens");
    let program = std::env::current_exe().expect("a program");
    let rights = Rights {
        read: vec!["/".into()],
        ..Rights::default()
    };
    confined(rights, move || {
        refused(TcpStream::connect(address));
        refused(TcpListener::bind("127.0.0.1:0"));
        refused(std::net::UdpSocket::bind("127.0.0.1:0"));
        refused(UnixStream::connect(&path));
        refused(Command::new(program).arg("--list").output());
        let parent = rustix::process::getppid().expect("a parent");
        let signal = rustix::process::test_kill_process(parent);
        assert_eq!(signal, Err(rustix::io::Errno::PERM));
        // A runtime still starts: its own socket pair is no way out.
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .enable_all()
            .build();
        runtime.expect("a runtime").block_on(async {});
    });
}

#[test]
fn a_library_in_a_store_leaves_the_network_and_nothing_else() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("listens");
    let address = listener.local_addr().expect("an address");
    let rights = Rights {
        network: true,
        ..Rights::default()
    };
    confined(rights, move || {
        TcpStream::connect(address).expect("connects");
        File::open("/etc/hosts").expect("names of hosts");
        refused(File::open("/root"));
        refused(Command::new("/bin/true").output());
    });
}

#[test]
fn a_path_that_is_not_there_is_named() {
    let rights = Rights {
        read: vec!["/nowhere/at/all".into()],
        ..Rights::default()
    };
    let error = files::restrict(&rights).expect_err("no such path");
    assert!(error.to_string().contains("/nowhere/at/all"), "{error}");
}
