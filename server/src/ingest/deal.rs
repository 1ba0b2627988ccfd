//! Dealing the meshes of a plan to its jobs.

use std::cmp::Reverse;

use serde::{Deserialize, Serialize};

/// A mesh of more than this part of a job's share is dealt on its own merits, not with its neighbours.
const LARGE_PART: u64 = 8;

/// A piece of work of a job.
///
/// A mesh that is too large for one machine will be several tasks: its pieces, and a last one that joins them. They are more
/// variants here, dealt like meshes; a program that does not know them refuses the plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum Task {
    /// Builds the mesh of this index in the plan.
    Mesh(u32),
}

/// What dealing needs to know of a mesh.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weight {
    /// Index of the file that holds it.
    pub input: u32,
    pub triangles: u64,
}

/// Gives every mesh to one of `jobs`. The large ones go, the largest first, to the job with the least to do; the small ones fill
/// the jobs up one after another in the order of the files, because a job reads every file of which it has a mesh. The same
/// meshes in the same order are dealt alike.
pub(super) fn deal(meshes: &[Weight], jobs: u32) -> Vec<Vec<Task>> {
    let jobs = jobs as usize;
    let total: u64 = meshes.iter().map(|mesh| mesh.triangles).sum();
    let share = total / jobs.max(1) as u64;
    let (mut large, mut small): (Vec<usize>, Vec<usize>) =
        (0..meshes.len()).partition(|&mesh| meshes[mesh].triangles > share / LARGE_PART);
    large.sort_by_key(|&mesh| (Reverse(meshes[mesh].triangles), mesh));
    small.sort_by_key(|&mesh| (meshes[mesh].input, mesh));

    let mut load = vec![0u64; jobs];
    let mut dealt = vec![vec![]; jobs];
    for mesh in large {
        let Some(job) = (0..jobs).min_by_key(|&job| load[job]) else {
            break;
        };
        load[job] += meshes[mesh].triangles;
        dealt[job].push(mesh as u32);
    }
    // Rooms of the jobs side by side, and the small meshes laid along them: each goes where its middle lies.
    let rooms: Vec<u64> = load
        .iter()
        .map(|load| share.saturating_sub(*load))
        .collect();
    let room: u64 = rooms.iter().sum();
    let all: u64 = small.iter().map(|&mesh| meshes[mesh].triangles).sum();
    let (mut job, mut room_end, mut before) = (0, rooms.first().copied().unwrap_or(0), 0);
    for mesh in small {
        let triangles = meshes[mesh].triangles;
        let middle = (2 * before + triangles) as u128 * room as u128 / (2 * all).max(1) as u128;
        while job + 1 < jobs && middle >= room_end as u128 {
            job += 1;
            room_end += rooms[job];
        }
        before += triangles;
        dealt[job].push(mesh as u32);
    }
    // In the order of the files, so that each is read once.
    for tasks in &mut dealt {
        tasks.sort_unstable();
    }
    let tasks = dealt.into_iter();
    tasks
        .map(|meshes| meshes.into_iter().map(Task::Mesh).collect())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn loads(meshes: &[Weight], dealt: &[Vec<Task>]) -> Vec<u64> {
        let triangles = |&Task::Mesh(mesh): &Task| meshes[mesh as usize].triangles;
        dealt
            .iter()
            .map(|tasks| tasks.iter().map(triangles).sum())
            .collect()
    }

    #[test]
    fn every_mesh_is_dealt_once_and_the_jobs_are_alike() {
        let sizes: [fn(u64) -> u64; 3] = [
            |index| 100 + index * index % 977,
            // A few that are as large as a job's share, and one larger.
            |index| if index % 40 == 7 { 5000 } else { 100 },
            |index| 10_000 / (index + 1) + 1,
        ];
        for size in sizes {
            let weight = |index| Weight {
                input: 0,
                triangles: size(index),
            };
            let meshes: Vec<Weight> = (0..200).map(weight).collect();
            let dealt = deal(&meshes, 7);
            assert_eq!(dealt, deal(&meshes, 7));
            let tasks = dealt.iter().flatten();
            let mut all: Vec<u32> = tasks.map(|&Task::Mesh(mesh)| mesh).collect();
            all.sort_unstable();
            assert_eq!(all, (0..200).collect::<Vec<_>>());
            let loads = loads(&meshes, &dealt);
            let largest = meshes.iter().map(|mesh| mesh.triangles).max().unwrap();
            let share = loads.iter().sum::<u64>() / 7;
            let most = *loads.iter().max().unwrap();
            assert!(most <= largest.max(share + share / 4), "{loads:?}");
        }
    }

    #[test]
    fn jobs_share_few_files() {
        // Eight files of fifty meshes, eight jobs: each job needs no more than two files.
        let meshes: Vec<Weight> = (0..400)
            .map(|index| Weight {
                input: index / 50,
                triangles: 1000,
            })
            .collect();
        for tasks in deal(&meshes, 8) {
            let mut files: Vec<u32> = tasks
                .iter()
                .map(|&Task::Mesh(mesh)| meshes[mesh as usize].input)
                .collect();
            files.dedup();
            assert!(files.len() <= 2, "{files:?}");
        }
    }

    #[test]
    fn more_jobs_than_meshes_and_no_meshes_at_all() {
        let one = [Weight {
            input: 0,
            triangles: 5,
        }];
        assert_eq!(deal(&one, 3), [vec![Task::Mesh(0)], vec![], vec![]]);
        assert_eq!(deal(&[], 2), [vec![], vec![]]);
    }

    #[test]
    fn a_task_that_is_not_known_is_refused() {
        let task: Task = serde_json::from_str(r#"{"mesh":3}"#).unwrap();
        assert_eq!(task, Task::Mesh(3));
        assert!(serde_json::from_str::<Task>(r#"{"piece":3}"#).is_err());
    }
}
