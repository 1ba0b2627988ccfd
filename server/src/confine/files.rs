//! Files by Landlock: what is not named cannot be opened, made, renamed or removed.

use std::path::Path;

use landlock::{
    ABI, Access, AccessFs, BitFlags, CompatLevel, Compatible, PathBeneath, PathFd, Ruleset,
    RulesetAttr, RulesetCreated, RulesetCreatedAttr, RulesetError, RulesetStatus, Scope,
    path_beneath_rules,
};

use super::{ConfineError, Rights};

/// The oldest version that is enough (Linux 5.13).
const LEAST: ABI = ABI::V1;
/// The newest version that this program knows: signals to other processes are refused too.
const BEST: ABI = ABI::V6;
/// Every process reads these: its own state, the cores that it may use, random numbers.
const ALWAYS: [&str; 5] = [
    "/proc/self",
    "/proc/meminfo",
    "/sys/fs/cgroup",
    "/dev/urandom",
    "/dev/null",
];
/// Names of hosts and certificates are looked up here.
const OF_NETWORK: [&str; 7] = [
    "/etc",
    "/usr/lib",
    "/usr/share",
    "/lib",
    "/lib64",
    "/run/systemd/resolve",
    "/proc/sys",
];

/// Leaves the files of `rights`, and the few that every process needs.
pub(super) fn restrict(rights: &Rights) -> Result<(), ConfineError> {
    let network: &[&str] = if rights.network { &OF_NETWORK } else { &[] };
    let read = AccessFs::from_read(BEST) & !AccessFs::Execute;
    let write = AccessFs::from_all(BEST)
        & !(AccessFs::Execute
            | AccessFs::MakeChar
            | AccessFs::MakeBlock
            | AccessFs::MakeFifo
            | AccessFs::MakeSock
            | AccessFs::MakeSym
            | AccessFs::IoctlDev);
    // A path of these that this system lacks is left out.
    let mut rules = ruleset()?
        .add_rules(path_beneath_rules(ALWAYS.iter().chain(network), read))
        .map_err(|error| refused(&error))?;
    for (paths, access) in [(&rights.read, read), (&rights.write, write)] {
        for path in paths {
            rules = with_path(rules, path, access)?;
        }
    }
    let status = rules.restrict_self().map_err(|error| refused(&error))?;
    match status.ruleset {
        RulesetStatus::NotEnforced => Err(refused(&"a system that does not enforce it")),
        _ => Ok(()),
    }
}

/// Fails where the system has no Landlock.
pub(super) fn check() -> Result<(), ConfineError> {
    ruleset().map(drop)
}

fn ruleset() -> Result<RulesetCreated, ConfineError> {
    let made = || -> Result<RulesetCreated, RulesetError> {
        Ruleset::default()
            .set_compatibility(CompatLevel::HardRequirement)
            .handle_access(AccessFs::from_all(LEAST))?
            .set_compatibility(CompatLevel::BestEffort)
            .handle_access(AccessFs::from_all(BEST))?
            .scope(Scope::from_all(BEST))?
            .create()
    };
    made().map_err(|error| refused(&error))
}

fn with_path(
    rules: RulesetCreated,
    path: &Path,
    access: BitFlags<AccessFs>,
) -> Result<RulesetCreated, ConfineError> {
    let cannot_open = |cause: String| ConfineError::Path {
        path: path.to_owned(),
        cause,
    };
    let opened = PathFd::new(path).map_err(|error| cannot_open(error.to_string()))?;
    let access = match path.is_dir() {
        true => access,
        false => access & AccessFs::from_file(BEST),
    };
    rules
        .add_rule(PathBeneath::new(opened, access))
        .map_err(|error| cannot_open(error.to_string()))
}

fn refused(found: &dyn std::fmt::Display) -> ConfineError {
    ConfineError::System {
        expected: "Landlock (Linux 5.13 or later, enabled)",
        found: found.to_string(),
    }
}
