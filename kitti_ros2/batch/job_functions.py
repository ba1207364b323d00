# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Functions that run the jobs of each command: from a task to its result.

Worker processes import them by name.
"""

from __future__ import annotations

import time
from contextlib import contextmanager
from dataclasses import asdict, replace
from functools import partial, wraps
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files.output_rules import (
    KEEP_ALL_BUT_JSON,
    KEEP_ALL_BUT_PAGES,
    json_text,
    losses_json,
    refusal_of,
)
from ..files.staging import staged_file
from ..model.bag_formats import CONTAINERS
from ..model.errors import KittiRos2Error, UsageError, describe_error, interruption_of
from .pool import JobResult

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from ..model.errors import Loss
    from ..options.read import ReadOptions
    from ..own_bags.to_bag import ExportReport
    from ..validation.rule import ValidationReport
    from .jobs import Job
    from .pool import Advance, JobTask, RunJob


# Helpers of the functions that run jobs: errors become reasons, losses lines of text.

_KEPT_LINES = 20


def guarded(work: RunJob) -> RunJob:
    """Decorate a function of jobs: measure its time, return errors of its data as the reason.

    Signals that end it are raised, also as broken locks.
    """

    @wraps(work)
    def run(task: JobTask, advance: Advance) -> JobResult:
        started = time.monotonic()
        try:
            result = work(task, advance)
        except (KittiRos2Error, OSError) as error:
            result = JobResult(reason=describe_error(error))
        except MemoryError:
            reason = 'not enough memory; lower --jobs, and run it again with --retry'
            result = JobResult(reason=reason)
        except Exception as error:  # noqa: BLE001 - one bad job does not stop the rest
            if interruption := interruption_of(error):
                raise interruption from None
            reason = f'internal error, {type(error).__name__}: {error}; please report it'
            result = JobResult(reason=reason)
        return replace(result, seconds=time.monotonic() - started)

    return run


def first_lines(lines: Iterable[str]) -> tuple[str, ...]:
    """Return the first few different lines."""
    return tuple(islice(dict.fromkeys(lines), _KEPT_LINES))


def loss_lines(losses: Iterable[Loss]) -> tuple[str, ...]:
    """Return the first few losses as lines."""
    return first_lines(f'{loss.stream} ({loss.count}): {loss.text()}' for loss in losses)


def write_job_json(task: JobTask, values: object) -> None:
    """Write the output of a job as JSON.

    Raises:
        OutputError: It exists and may not be replaced, or the disk refuses.
    """
    refusal = refusal_of(KEEP_ALL_BUT_JSON, overwrite=bool(task.options.get('overwrite')))
    with staged_file(task.out, refusal) as path:
        path.write_text(json_text(values), 'utf-8')


@contextmanager
def samples_shown(advance: Advance, samples: int, _frames: int) -> Iterator[Advance]:
    """Yield a function that shows the samples done and the bytes of a conversion."""
    yield lambda done, _bytes: advance(done, samples)


# The job of to-bag: one recording, or a slice of one, to one bag.


def bag_suffix(options: Mapping[str, object]) -> str:
    """Return the suffix of the bags: a container's, or empty for directories.

    Raises:
        UsageError: An option is invalid.
    """
    from ..bags.writer import guess_storage  # noqa: PLC0415 - as below
    from ..options.table import make_settings  # noqa: PLC0415 - as below

    settings = make_settings(options)
    storage = guess_storage(Path(), settings.storage)
    bag = settings.bag(storage)
    container = CONTAINERS[storage]
    return container.suffix if container.in_file and not bag.split else ''


@guarded
def run_bag_job(task: JobTask, advance: Advance) -> JobResult:
    """Convert a recording; errors of its data become the reason of failure."""
    report = _exported(task, advance)
    return JobResult(
        counts={
            'frames': report.frames,
            'messages': sum(report.counts.values()),
            'bytes': report.size_bytes,
        },
        bad=sum(loss.count for loss in report.losses),
        losses=loss_lines(report.losses),
        notes=report.notes,
    )


def _exported(task: JobTask, advance: Advance) -> ExportReport:
    # Imports of one kind of jobs take tenths of a second; workers import this file at the start.
    from ..bags.open_source import open_folder  # noqa: PLC0415
    from ..kitti.extract_oxts import add_extract  # noqa: PLC0415
    from ..kitti.prepare import add_predictions  # noqa: PLC0415
    from ..options.read import Bound  # noqa: PLC0415
    from ..options.table import make_settings  # noqa: PLC0415
    from ..own_bags.to_bag import ExportOptions, convert  # noqa: PLC0415

    job, settings = task.job, make_settings(task.options)
    read = replace(settings.read, layout=job.layout, sequence=job.sequence)
    selection = settings.selection
    if job.first is not None:
        if not selection.is_whole:
            raise UsageError('--slice-frames chooses the frames; leave --start and --end out')
        selection = replace(selection, start=Bound(frame=job.first), end=Bound(frame=job.last))
    recording = open_folder(job.source, read)
    add_predictions(recording, settings.predictions.path)
    add_extract(recording, settings.imu)
    return convert(
        recording,
        task.out,
        ExportOptions.of(replace(settings, selection=selection), task.out),
        progress=partial(samples_shown, advance),
    )


# The job of to-kitti: one bag, to one folder.

PLAN_FILE = 'plan_file'
"""Name of the plan among the options of a job."""


@guarded
def run_kitti_job(task: JobTask, advance: Advance) -> JobResult:
    """Convert a bag; errors of its data become the reason of failure."""
    from ..bags.open_source import open_bag_source  # noqa: PLC0415 - as above
    from ..options.table import make_import_options  # noqa: PLC0415 - as above
    from ..own_bags.to_kitti import Conversion  # noqa: PLC0415 - as above

    job_options = dict(task.options)
    plan_file = job_options.pop(PLAN_FILE, None)
    options = make_import_options(job_options)
    notes: list[str] = []
    with open_bag_source(task.job.source, whole_chunks=True) as bag:
        conversion = Conversion(
            [bag],
            task.out,
            options,
            plan_file,  # type: ignore[arg-type] # a path, set by the command
            notes.append,
            partial(samples_shown, advance),
        )
        reports = conversion.run()
    losses = [loss for report in reports for loss in report.losses]
    return JobResult(
        counts={
            'frames': sum(report.frames for report in reports),
            'files': sum(sum(report.counts.values()) for report in reports),
            'bytes': sum(report.size_bytes for report in reports),
        },
        bad=sum(loss.count for loss in losses),
        losses=loss_lines(losses),
        notes=(*notes, *(note for report in reports for note in report.notes)),
    )


# The job of report: one recording or bag, to its HTML page.


@guarded
def run_report_job(task: JobTask, advance: Advance) -> JobResult:
    """Write the report of a recording or bag; errors of its data become the reason of failure."""
    from ..options.table import make_settings  # noqa: PLC0415 - as above
    from ..report.gather import gather  # noqa: PLC0415 - as above
    from ..report.page import make_page  # noqa: PLC0415 - as above

    job = task.job
    read = make_settings({n: v for n, v in task.options.items() if n != 'overwrite'}).read
    report = gather(job.source, replace(read, layout=job.layout, sequence=job.sequence), advance)
    refusal = refusal_of(KEEP_ALL_BUT_PAGES, overwrite=bool(task.options.get('overwrite')))
    with staged_file(task.out, refusal) as path:
        size = path.write_bytes(make_page(report).encode())
    losses = [issue for issue in report.issues if issue.is_loss]
    return JobResult(
        counts={'frames': report.frames or 0, 'bytes': size},
        bad=len(losses),
        losses=first_lines(
            f'{loss.where + ": " if loss.where else ""}{loss.text}' for loss in losses
        ),
    )


# The job of stats: one recording or bag, to its statistics as JSON.


@guarded
def run_statistics_job(task: JobTask, advance: Advance) -> JobResult:
    """Count the contents of a recording or bag; errors of its data become the reason of failure."""
    from ..datasets.set_statistics import count_set, find_sources, plain_values  # noqa: PLC0415 - as above
    from ..options.datasets import make_statistics_options  # noqa: PLC0415 - as above

    job = task.job
    job_options = {name: value for name, value in task.options.items() if name != 'overwrite'}
    read, options = make_statistics_options(job_options)
    read = replace(read, layout=job.layout, sequence=job.sequence)
    statistics = count_set(job.source, find_sources(job.source, read), options, advance)
    write_job_json(task, plain_values(statistics))
    return JobResult(
        counts={'frames': statistics.total.frames, 'objects': statistics.total.objects},
        bad=sum(loss.count for loss in statistics.total.losses),
        losses=loss_lines(statistics.total.losses),
    )


# The job of validate: one recording or bag, to its findings as JSON.


@guarded
def run_validation_job(task: JobTask, advance: Advance) -> JobResult:
    """Check a recording or bag; its errors are findings, not failures.

    Only a job that cannot be checked at all fails.
    """
    from ..validation.validate import validate  # noqa: PLC0415 - as above

    job = task.job
    keywords: Any = {name: value for name, value in task.options.items() if name != 'overwrite'}
    keywords |= {'layout': job.layout, 'sequence': job.sequence}
    report = validate(job.source, progress=advance, **keywords)
    write_job_json(task, {**asdict(report), 'ok': report.ok})
    return JobResult(
        counts={
            'files': sum(source.files for source in report.sources),
            'warnings': report.warnings,
            'bytes': sum(source.size_bytes for source in report.sources),
        },
        bad=report.errors,
        losses=first_lines(_error_lines(report)),
    )


def _error_lines(report: ValidationReport) -> Iterator[str]:
    from ..validation.rule import RuleSeverity  # noqa: PLC0415 - as above

    for finding in report.findings:
        if finding.severity == RuleSeverity.ERROR.value:
            yield f'{finding.rule}: {finding.place}: {finding.message} ({finding.remedy})'


# The jobs of evaluations: a result with its ground truth, to its scores as JSON.


@guarded
def run_detection_job(task: JobTask, _: Advance) -> JobResult:
    """Score detections; errors of the data become the reason of failure."""
    from ..evaluation.detection import score_detection  # noqa: PLC0415 - as above
    from ..evaluation.score_values import detection_values  # noqa: PLC0415 - as above
    from ..options.evaluation import make_detection_options  # noqa: PLC0415 - as above

    read, options, recorded = make_detection_options(_chosen(task))
    layout = task.job.layout
    if layout is None or not layout.traits.frame_set:  # read from label_2
        read = _read(task.job, read)
    scores = score_detection(task.job.source, _result(task.job), read, options, recorded)
    return _finish(task, detection_values(scores), scores.frames, scores.losses)


@guarded
def run_tracking_job(task: JobTask, advance: Advance) -> JobResult:
    """Score tracks; errors of the data become the reason of failure."""
    from ..evaluation.score_values import tracking_values  # noqa: PLC0415 - as above
    from ..evaluation.track_metrics import plain_parts  # noqa: PLC0415 - as above
    from ..evaluation.tracking import score_tracking  # noqa: PLC0415 - as above
    from ..options.evaluation import make_tracking_options  # noqa: PLC0415 - as above

    read, options = make_tracking_options(_chosen(task))
    read = replace(read, sequence=task.job.sequence)
    scores = score_tracking(task.job.source, _result(task.job), read, options, advance)
    values = {**tracking_values(scores), 'parts': plain_parts(scores.parts)}
    return _finish(task, values, scores.frames, scores.losses)


@guarded
def run_odometry_job(task: JobTask, _: Advance) -> JobResult:
    """Score a trajectory; errors of the data become the reason of failure."""
    from ..evaluation.odometry import score_odometry  # noqa: PLC0415 - as above
    from ..evaluation.score_values import odometry_values  # noqa: PLC0415 - as above
    from ..options.evaluation import make_odometry_options  # noqa: PLC0415 - as above

    read, options = make_odometry_options(_chosen(task))
    read = _read(task.job, read)
    scores = score_odometry(task.job.source, _result(task.job), read, options)
    poses = int(scores.known.sum())
    counted = {'ape_poses': len(scores.errors.ape_m), 'rpe_pairs': len(scores.errors.rpe_m)}
    return _finish(task, {**odometry_values(scores), **counted}, poses, scores.losses)


def _chosen(task: JobTask) -> dict[str, object]:
    return {name: value for name, value in task.options.items() if name != 'overwrite'}


def _read(job: Job, read: ReadOptions) -> ReadOptions:
    return replace(read, layout=job.layout, sequence=job.sequence)


def _result(job: Job) -> Path:
    if job.result is None:
        raise RuntimeError(f'{job.name}: a unit of an evaluation without a result')
    return job.result


def _finish(
    task: JobTask, values: dict[str, Any], frames: int, losses: Sequence[Loss]
) -> JobResult:
    """Write the scores with their inputs and losses."""
    about = {'ground_truth': task.job.source, 'sequence': task.job.sequence}
    write_job_json(
        task,
        {**about, 'result': task.job.result, **values, 'losses': losses_json(losses)},
    )
    return JobResult(
        counts={'frames': frames},
        bad=sum(loss.count for loss in losses),
        losses=loss_lines(losses),
    )
