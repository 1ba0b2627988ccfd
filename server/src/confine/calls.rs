//! System calls by seccomp: no new programs, no hand on other processes, and no sockets. A refused
//! call fails with `EPERM`, as one without rights does.

use seccompiler::{
    BackendError, BpfProgram, SeccompAction, SeccompCmpArgLen, SeccompCmpOp, SeccompCondition,
    SeccompFilter, SeccompRule, apply_filter,
};

use super::ConfineError;

/// Calls that no build makes: they start programs, look into other processes, change what the
/// process may do, or reach parts of the kernel that were often attacked. io_uring would make
/// sockets.
const NEVER: [libc::c_long; 35] = [
    libc::SYS_execve,
    libc::SYS_execveat,
    libc::SYS_ptrace,
    libc::SYS_process_vm_readv,
    libc::SYS_process_vm_writev,
    libc::SYS_pidfd_getfd,
    libc::SYS_pidfd_open,
    libc::SYS_pidfd_send_signal,
    libc::SYS_kcmp,
    libc::SYS_kill,
    libc::SYS_tkill,
    libc::SYS_io_uring_setup,
    libc::SYS_io_uring_enter,
    libc::SYS_io_uring_register,
    libc::SYS_bpf,
    libc::SYS_perf_event_open,
    libc::SYS_userfaultfd,
    libc::SYS_add_key,
    libc::SYS_request_key,
    libc::SYS_keyctl,
    libc::SYS_unshare,
    libc::SYS_setns,
    libc::SYS_mount,
    libc::SYS_umount2,
    libc::SYS_pivot_root,
    libc::SYS_chroot,
    libc::SYS_open_by_handle_at,
    libc::SYS_init_module,
    libc::SYS_finit_module,
    libc::SYS_delete_module,
    libc::SYS_kexec_load,
    libc::SYS_reboot,
    libc::SYS_swapon,
    libc::SYS_mknodat,
    libc::SYS_acct,
];
/// Ways to sockets. The socket pair that a runtime keeps for its signals is none of them.
const NETWORK: [libc::c_long; 6] = [
    libc::SYS_socket,
    libc::SYS_connect,
    libc::SYS_bind,
    libc::SYS_listen,
    libc::SYS_accept,
    libc::SYS_accept4,
];
/// Signals to threads: of this process only.
const SIGNALS: [libc::c_long; 2] = [libc::SYS_tgkill, libc::SYS_rt_tgsigqueueinfo];

/// Refuses the calls from now on, in this thread and those that it starts.
pub(super) fn refuse(network: bool) -> Result<(), ConfineError> {
    let refused = |error: &dyn std::fmt::Display| ConfineError::System {
        expected: "seccomp filters",
        found: error.to_string(),
    };
    let program = program(network).map_err(|error| refused(&error))?;
    apply_filter(&program).map_err(|error| refused(&error))
}

fn program(network: bool) -> Result<BpfProgram, BackendError> {
    let sockets: &[libc::c_long] = if network { &[] } else { &NETWORK };
    let mut rules: std::collections::BTreeMap<_, _> = NEVER
        .iter()
        .chain(sockets)
        .map(|call| (*call, vec![]))
        .collect();
    let own = u64::from(std::process::id());
    for call in SIGNALS {
        let other = SeccompCondition::new(0, SeccompCmpArgLen::Dword, SeccompCmpOp::Ne, own)?;
        rules.insert(call, vec![SeccompRule::new(vec![other])?]);
    }
    let refusal = SeccompAction::Errno(libc::EPERM.unsigned_abs());
    let arch = std::env::consts::ARCH.try_into()?;
    SeccompFilter::new(rules, SeccompAction::Allow, refusal, arch)?.try_into()
}
