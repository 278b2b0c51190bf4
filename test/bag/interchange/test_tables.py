"""Files of other programs in, tables out: exact, and every fault named with its place."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from bags_made import assert_same, make_record
from scipy.io import savemat

from hunt_ros.bag import read_record, write_record
from hunt_ros.bag.interchange.exporters import aligned, export_file
from hunt_ros.bag.interchange.importers import load_record
from hunt_ros.bag.interchange.tables import load_table, select
from hunt_ros.cli.main import main
from hunt_ros.errors import BagError
from hunt_ros.samples import Record, Series


def import_file(file: Path, out: Path, *channels, **options) -> Path:
    return write_record(out, load_record(file, *channels, **options))


MAPPING = ['yaw=data[0]', 'lateral=data[1]*0.47', 'speed=16.3']


@pytest.fixture
def matrix() -> np.ndarray:
    return np.random.default_rng(2).normal(size=(6, 500))


def check_matrix(record: Record, matrix: np.ndarray) -> None:
    np.testing.assert_array_equal(record['yaw'].values, matrix[0])
    np.testing.assert_array_equal(record['lateral'].values, matrix[1] * 0.47)
    np.testing.assert_array_equal(
        record['yaw'].stamps_ns, 10**9 + np.round(np.arange(500) * 4e6).astype(np.int64)
    )
    assert set(record['speed'].values) == {16.3}
    assert record['speed'].stamps_ns[0] == record['yaw'].stamps_ns[0]
    assert record['speed'].stamps_ns[-1] == record['yaw'].stamps_ns[-1]


def test_matlab_5_and_7_3_and_numpy_hold_the_same(matrix: np.ndarray, tmp_path: Path) -> None:
    savemat(tmp_path / 'five.mat', {'data': matrix})
    h5py = pytest.importorskip('h5py', reason='the extra matlab73 is not installed')
    pytest.importorskip('pymatreader', reason='the extra matlab73 is not installed')
    with h5py.File(tmp_path / 'seven.mat', 'w', userblock_size=512) as file:
        file.create_dataset('data', data=matrix.T).attrs['MATLAB_class'] = np.bytes_('double')
    head = b'MATLAB 7.3 MAT-file'.ljust(124) + b'\x00\x02IM'
    with open(tmp_path / 'seven.mat', 'r+b') as raw:
        raw.write(head)
    np.save(tmp_path / 'one.npy', matrix)
    np.savez(tmp_path / 'many.npz', data=matrix)
    for name in ('five.mat', 'seven.mat', 'one.npy', 'many.npz'):
        check_matrix(load_record(tmp_path / name, MAPPING, rate_hz=250.0), matrix)


def test_matlab_structures_are_followed(tmp_path: Path) -> None:
    savemat(tmp_path / 's.mat', {'run': {'daq': {'y': np.arange(5.0)}, 't': np.arange(5.0)}})
    record = load_record(tmp_path / 's.mat', ['lateral=run.daq.y'], time='run.t')
    np.testing.assert_array_equal(record['lateral'].values, np.arange(5.0))
    with pytest.raises(BagError, match=r"no 'z' for 'run\.z', it has daq, t"):
        load_record(tmp_path / 's.mat', ['lateral=run.z'], time='run.t')


@pytest.mark.parametrize(
    ('text', 'channels'),
    [
        ('t,y\n0,10\n0.5,20\n', ['lateral=y*0.001']),
        ('t\ty\n0\t10\n0.5\t20\n', ['lateral=y*0.001']),
        ('t|y\n0|10\n0.5|20\n', ['lateral=y*0.001']),
        ('| t | y |\n|---|---|\n| 0 | 10 |\n| 0.5 | 20 |\n', ['lateral=y*0.001']),
        # A name with its unit is that of its column; the factor is applied once.
        ('t;Weg 1 [mm]\n0;10\n0.5;20\n', ['lateral=Weg 1 [mm]*0.001']),
        ('t;Weg 1 [mm]\n0;10\n0.5;20\n', ['lateral=Weg 1*0.001']),
        ('t;Weg [mm];Weg [V]\n0;10;1\n0.5;20;2\n', ['lateral=Weg [mm]*0.001']),
        ('# made by a logger\nt y\n0 10\n0.5 20\n', ['lateral=y*0.001']),
        ('t;y\ns;mm\n0;10\n0,5;20\n', ['lateral=y*0.001']),
        ('\ufefft, y\n0, 10\n\n0.5, 20\n\n', ['lateral=y*0.001']),
        ('t,lateral\n\n0,0.01\n\n0.5,0.02\n', []),
        ('# rig 1\n# t,lateral\n0,0.01\n0.5,0.02\n', []),  # numpy.savetxt
        ('measured today\n# t lateral\n0 0.01\n0.5 0.02\n', []),
        ('measured by me\nt lateral\n0 0.01\n0.5 0.02\n', []),
        ('t,lateral,remark,ok\n0,0.01,start,TRUE\n0.5,0.02,,FALSE\n', []),
        ('t,lateral,remark\r\n0,0.01,a\x85b\r\n0.5,0.02,c\u2028d\r\n', []),
        ('t,lateral\r0,0.01\r0.5,0.02\r', []),
        # A constant leaves the columns that are found by name.
        ('t,lateral,speed_setpoint\n0,0.01,9\n0.5,0.02,9\n', ['speed=5']),
        ('1,10\n2,20\n', ['lateral=c1*0.001']),  # without names its columns are counted
        # Separators that end every line, and cells that a spreadsheet adds.
        ('t,lateral\n0,0.01,\n0.5,0.02,\n', []),
        ('t,lateral,\n0,0.01\n0.5,0.02\n', []),
        ('rig 1;;;\nt;lateral;;\n0;0,01;;\n0,5;0,02;;\n', []),
        ('"t" , "lateral" \n"0", "0,01"\n"0,5", "0,02"\n', []),
        ('t;lateral;x;x\n0;0,01;1;2\n0,5;0,02;1;2\n', []),
        ('Zeit;lateral\n04.03.2024 13:59:59,75;0,01\n04.03.2024 14:00:00,25;0,02\n', []),
        ('time;lateral\n23:59:59.75;0.01\n00:00:00.25;0.02\n', []),
    ],
)
def test_csv_in_the_forms_loggers_write(tmp_path: Path, text: str, channels: list[str]) -> None:
    (tmp_path / 'a.csv').write_text(text, encoding='utf-8')
    rate = {'rate_hz': 2.0} if 'lateral=c1*0.001' in channels else {}
    record = load_record(tmp_path / 'a.csv', channels, **rate)
    np.testing.assert_allclose(record['lateral'].values, [0.01, 0.02], rtol=1e-15)
    np.testing.assert_array_equal(np.diff(record['lateral'].stamps_ns), [5 * 10**8])
    assert set(record) == {'lateral', *(['speed'] if 'speed=5' in channels else [])}


def test_a_remark_is_no_line_of_units_and_a_share_no_number(tmp_path: Path) -> None:
    file = tmp_path / 'daq.csv'
    rows = [f'{row},0.001' for row in range(50)]
    file.write_text(
        '\n'.join(['t_ms,lateral', '# mark 0', *rows[:20], '# mark 1', *rows[20:], ''])
    )
    assert len(load_record(file)['lateral']) == 50
    file.write_text('\n'.join(['t_ms,lateral', *rows, '50,5%', '']))
    with pytest.raises(BagError, match="line 52: '5%' is not a number"):
        load_record(file)


@pytest.mark.parametrize('remark', ['3', 'a word'], ids=['all at once', 'cell by cell'])
@pytest.mark.parametrize('mark', [',', ';', '\t', '|'])
def test_an_empty_cell_is_no_sample_of_its_column(tmp_path: Path, mark: str, remark: str) -> None:
    """Whole nanoseconds keep all their digits beside it, and "nan" is a sample that failed."""
    rows = [
        't_ns,lateral,yaw,x,speed',
        '2000000000000000001,0.001,,3,7',
        '2000000000000000002,,,3,7',
    ]
    rows += ['2000000000000000003,nan, ,3,7', f'2000000000000000004,0.002,0.5,{remark},']
    (tmp_path / 'a.csv').write_text('\n'.join(rows).replace(',', mark) + '\n')
    found = load_record(tmp_path / 'a.csv')
    assert (found['yaw'].stamps_ns % 10).tolist() == [4]
    assert (found['lateral'].stamps_ns % 10).tolist() == [1, 3, 4]
    assert (found['speed'].stamps_ns % 10).tolist() == [1, 2, 3]
    assert np.isnan(found['lateral'].values).tolist() == [False, True, False]


def test_names_in_an_unknown_encoding_say_what_they_were_read_as(tmp_path: Path) -> None:
    text = '時間,横変位\n' + ''.join(f'{row},0.001\n' for row in range(9))
    (tmp_path / 'a.csv').write_bytes(text.encode('shift_jis'))
    with pytest.raises(BagError, match='its names are no UTF-8, and were read as Latin-1'):
        load_record(tmp_path / 'a.csv', ['lateral=横変位'], time='時間')


@pytest.mark.parametrize('end', ['2,2.', '2,2.5e-0', '2', '2,2.5\0\0\0'])
def test_a_last_line_that_was_cut_is_left_out_and_told(tmp_path: Path, capsys, end: str) -> None:
    (tmp_path / 'a.csv').write_text(f't,lateral\n0,0.01\n1,0.02\n{end}')
    assert main(['import', str(tmp_path / 'a.csv'), str(tmp_path / 'out')]) == 0
    assert 'left out: line 4, which does not end' in capsys.readouterr().out
    assert read_record(tmp_path / 'out')['lateral'].values.tolist() == [0.01, 0.02]


def test_times_that_are_none_are_refused(tmp_path: Path) -> None:
    microseconds, too_late = np.arange(300) * 10_000, np.arange(300) * 10**16
    for times in (microseconds, too_late.astype('datetime64[us]')):
        np.savez(tmp_path / 'a.npz', lateral=np.zeros(300), t=times)
        with pytest.raises(BagError, match=r'clock was not set|reaches beyond'):
            load_record(tmp_path / 'a.npz', ['speed=5'], time='t')


def test_export_and_import_is_the_identity(tmp_path: Path) -> None:
    record = make_record(seconds=0.5)
    values = record['yaw'].values.copy()
    values[7] = np.nan  # a sample that failed stays one
    record = Record({**record, 'yaw': Series(record['yaw'].stamps_ns, values)})
    bag = write_record(tmp_path / 'run', record)
    rows = export_file(bag, tmp_path / 'out.csv')
    assert rows == len(set(np.concatenate([s.stamps_ns for s in record.values()]).tolist()))
    again = read_record(import_file(tmp_path / 'out.csv', tmp_path / 'again'))
    assert_same(record, again)


def test_any_field_is_exported_under_any_name(bag: Path, record, tmp_path: Path) -> None:
    export_file(bag, tmp_path / 'a.csv', ['v, raw=/rig/speed.twist.linear.x*3.6'])
    with open(tmp_path / 'a.csv', newline='') as file:
        rows = list(csv.reader(file))
    assert rows[0] == ['stamp_ns', 'v, raw']
    assert [float(row[1]) for row in rows[1:]] == (record['speed'].values * 3.6).tolist()
    assert [int(row[0]) for row in rows[1:]] == record['speed'].stamps_ns.tolist()


def test_equal_stamps_get_rows_of_their_own() -> None:
    stamps, columns = aligned(
        {
            'a': Series([1, 2, 2, 3], [1.0, 2.0, 2.5, 3.0]),
            'b': Series([2, 4], [20.0, 40.0]),
        }
    )
    assert stamps.tolist() == [1, 2, 2, 3, 4]
    assert columns['a'].tolist() == [1.0, 2.0, 2.5, 3.0, None]
    assert columns['b'].tolist() == [None, 20.0, None, None, 40.0]


@pytest.mark.parametrize(
    ('name', 'text', 'channels', 'words'),
    [
        ('a.csv', 't,y\n0,1\n1,x\n', ['lateral=y'], r"line 3: 'x' is not a number"),
        ('a.csv', 't,y\n0,1\n1\n', ['lateral=y'], 'line 3 has 1 cells, expected 2'),
        ('a.csv', 't,y,y\n0,1,2\n', ['lateral=y'], "'y' occurs twice"),
        ('a.csv', 't,y\n', ['lateral=y'], 'no numbers'),
        (
            'a.csv',
            'd,y\n3/4/24 9:00,1\n3/4/24 9:01,1\n',
            ['lateral=y'],
            r"'3/4/24 9:00' is no time",
        ),
        ('a.csv', 't,y\n0,1\n1,2,3\n', ['lateral=y'], 'line 3 has 3 cells, expected 2'),
        ('a.csv', '', ['lateral=y'], 'no lines'),
        ('a.csv', 't,y\n0,1\n1,2\n', ['lateral=z'], "no 'z' for 'z', it has t, y"),
        ('a.csv', 't,y\n0,1\n1,2\n', [], 'no column named lateral'),
        ('a.csv', 'x,y\n0,1\n1,2\n', ['lateral=y'], 'no column of times'),
        ('a.csv', 't,y\n0,1\n-1,2\n', ['lateral=y'], 't goes backwards in row 1'),
        ('a.csv', 't,y\n0,1\n,2\n', ['lateral=y'], 't is not finite in row 1'),
        ('a.csv', 't,y\n0,\n1,\n', ['lateral=y'], 'no finite number'),
        ('a.csv', 't,y\n0,1\n', ['lateral=y'], 'no channel has more'),
        ('a.csv', f't,y\n0,1\n1,{"0" * 999}x\n', ['lateral=y'], r"line 3: '0{40}' is not a"),
        ('a.csv', 't,y\n0,1\n1,2\n', ['speed=3'], 'no channel has more'),
        ('a.csv', 't,y\n0,1\n1,2\n', ['speed=y[1]'], 'no channel has more'),
        ('a.csv', 't,lateral\n[s],[furlong]\n0,1\n1,2\n', [], 'unknown unit of lateral'),
        ('a.csv', 't,lateral [in]\n0,1\n1,2\n', ['speed=3'], 'unknown unit of lateral'),
        (
            'a.csv',
            't,lateral_m\n[s],[mm]\n0,1\n1,2\n',
            [],
            'lateral_m is in mm by the line of units',
        ),
        ('a.csv', 't,y_mm\n0,1\n1,2\n', ['lateral=y_mm'], r'lateral=y_mm\*0.001'),
        (
            'a.csv',
            't,lateral,lateral_mm\n0,1,2\n1,2,3\n',
            [],
            'lateral and lateral_mm are both lateral',
        ),
        ('a.csv', 't;y\n0;1,000\n7.200;2,000\n', ['lateral=y'], 'which is the decimal mark'),
        # Digits in groups of thousands.
        ('a.csv', 't,y\n0,"1,000.0"\n1,"2,000.0"\n', ['lateral=y'], 'line 2: .* is not a number'),
        ('a.csv', 't;y\n0,0;1.000,0\n0,5;2.000,0\n', ['lateral=y'], 'line 2: .* not a number'),
        ('a.csv', 't,Lateral Displacement,speed\n0,1,2\n1,2,3\n', [], 'unknown unit of lateral'),
        ('a.csv', 't,lateral\n[h],[mm]\n0,1\n1,2\n', [], "unknown unit 'h' of a time"),
        ('a.mat', 'hello', ['lateral=y'], 'cannot be read as .mat'),
        ('a.npy', 'hello', ['lateral=y'], 'cannot be read as .npy'),
        ('a.xls', 'hello', ['lateral=y'], "unknown format '.xls'"),
    ],
)
def test_faults_are_named_with_their_place(tmp_path: Path, name, text, channels, words) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(BagError, match=words) as caught:
        import_file(tmp_path / name, tmp_path / 'out', channels)
    assert '\n' not in str(caught.value)
    assert not (tmp_path / 'out').exists()


def test_shapes_that_are_no_series_say_what_is_there(matrix, tmp_path: Path) -> None:
    np.save(tmp_path / 'a.npy', matrix)
    table = load_table(tmp_path / 'a.npy')
    np.testing.assert_array_equal(select(table, 'data[:,3]'), matrix[:, 3])
    for source, words in (
        ('data', 'data is 6 x 500, expected a series'),
        ('data[9]', r'no \[9\] in 6 x 500'),
        ('data[0', 'expected an index'),
        ('data[x]', r'no \[x\]'),
    ):
        with pytest.raises(BagError, match=words):
            select(table, source)


def test_a_structure_with_a_list_beside_numbers_is_one_of_which_0_is_the_first() -> None:
    one = {'run': {'names': ['a', 'b'], 'y': np.arange(3.0)}}
    np.testing.assert_array_equal(select(one, 'run[0].y'), np.arange(3.0))
    several = {'run': {'y': [np.zeros(2), np.ones(2)], 'v': [1.0, 2.0]}}  # as version 7.3 has them
    np.testing.assert_array_equal(select(several, 'run[1].y'), np.ones(2))


def test_a_pickle_is_never_opened(tmp_path: Path) -> None:
    np.save(tmp_path / 'a.npy', np.array([{'a': 1}], dtype=object), allow_pickle=True)
    with pytest.raises(BagError, match='cannot be read'):
        load_table(tmp_path / 'a.npy')


@pytest.mark.parametrize(
    'text',
    [
        't,lateral,speed\n[s],[mm],[km/h]\n0,1,36\n0.5,2,72\n',
        't;lateral;speed\ns;mm;km/h\n0;1;36\n0,5;2;72\n',
        'Time [ms],Lateral [mm],Speed [km/h]\n0,1,36\n500,2,72\n',
        'time [msec],lateral [mm],speed [m/sec]\n0,1,10\n500,2,20\n',
        't (s),lateral (mm),speed (km/h)\n0,1,36\n0.5,2,72\n',
        't, s;lateral, mm;speed, km/h\n0;1;36\n0,5;2;72\n',
        'Made by,a logger\nrate,2\n\nt,lateral,speed\ns,mm,km/h\n0,1,36\n0.5,2,72\n',
        'time_s,lateral_mm,speed_kmh\n(s),(mm),(km/h)\n0,1,36\n0.5,2,72\n',
        'time_ms,lateral_um,speed_kmh\n0,1000,36\n500,2000,72\n',
        'Date,lateral_mm,speed_kmh\n2026-11-23T10:00:00.25,1,36\n2026-11-23T10:00:00.75,2,72\n',
        'Date,lateral_mm,speed_kmh\n2026-11-23 10:00:00.25Z,1,36\n'
        '2026-11-23 12:00:00.75+02:00,2,72\n',
        # DASYLab, catman: as they export.
        'DASYLab\nAufnahmedatum: 04.03.2024\nMesszeit [s];lateral [mm];speed [km/h]\n'
        '0,000;1,0;36,0\n0,500;2,0;72,0\n',
        'CATMAN\nANZAHL: 3\n\nCH 1\tCH 2\tCH 3\nTime 1\tlateral\tspeed\ns\tmm\tkm/h\n'
        'T0\tCal 1\t\n0,0\t1,0\t36\n0,5\t2,0\t72\n',
        't lateral_mm speed_kmh\n 0 1,0 36\n 0,5 2,0 72\n',
        # Excel writes its empty rows as separators.
        'Made by;a logger;\n;;\nt;lateral;speed\ns;mm;km/h\n;;\n0;1;36\n0,5;2;72\n;;\n',
    ],
)
@pytest.mark.parametrize('encoding', ['utf-8', 'utf-16', 'utf-16-le', 'utf-16-be', 'latin-1'])
def test_a_unit_that_the_file_tells_is_the_unit(tmp_path: Path, text: str, encoding: str) -> None:
    (tmp_path / 'a.csv').write_text(text, encoding=encoding)
    record = load_record(tmp_path / 'a.csv')
    np.testing.assert_allclose(record['lateral'].values, [0.001, 0.002])
    np.testing.assert_allclose(record['speed'].values, [10.0, 20.0])
    np.testing.assert_array_equal(np.diff(record['lateral'].stamps_ns), [5 * 10**8])


@pytest.mark.parametrize(
    ('unit', 'words'),
    [('mm', r'expected a factor: lateral=y\*0.001'), ('Millimeter', 'm, mm, um are known'),
     ('inch', r'lateral=y\*FACTOR')],
)  # fmt: skip
def test_a_column_in_another_unit_needs_its_factor(tmp_path: Path, unit: str, words: str) -> None:
    (tmp_path / 'a.csv').write_text(f't,y\n[s],[{unit}]\n0,1\n1,2\n')
    with pytest.raises(BagError, match=words):
        load_record(tmp_path / 'a.csv', ['lateral=y'])
    record = load_record(tmp_path / 'a.csv', ['lateral=y*0.001'])
    np.testing.assert_allclose(record['lateral'].values, [0.001, 0.002])


@pytest.mark.parametrize('stamps', [(0, 1_700_000_000), (-5, 1_700_000_000)])
def test_a_stamp_before_the_clock_was_set_is_refused(tmp_path: Path, stamps) -> None:
    rows = ''.join(f'{stamp}000000000,0\n' for stamp in (*stamps, stamps[1] + 1, stamps[1] + 2))
    (tmp_path / 'a.csv').write_text(f'stamp_ns,lateral\n{rows}')
    with pytest.raises(BagError, match='its clock was not set'):
        load_record(tmp_path / 'a.csv')


def test_rate_and_times_contradict_each_other(tmp_path: Path) -> None:
    (tmp_path / 'a.csv').write_text('t,lateral\n0,1\n1,2\n')
    with pytest.raises(BagError, match='not both'):
        load_record(tmp_path / 'a.csv', rate_hz=10.0, time='t')


@pytest.mark.parametrize('airspeed', ['runs[2].airspeed', 'runs[2].fast'])
def test_a_run_of_a_structure_array_becomes_a_record(tmp_path: Path, airspeed) -> None:
    kind = [('plunge', object), ('airspeed', object), ('fast', object)]
    runs = np.zeros(3, dtype=kind)
    for row in range(3):
        runs[row] = (np.arange(50.0 + row) + 100 * row, 10.0 + row, np.full(50 + row, 10.0 + row))
    savemat(tmp_path / 'a.mat', {'runs': runs})
    channels = ['lateral=runs[2].plunge*0.001', f'speed={airspeed}']
    one = load_record(tmp_path / 'a.mat', channels, rate_hz=100.0)
    np.testing.assert_allclose(one['lateral'].values, (np.arange(52.0) + 200) * 0.001)
    np.testing.assert_array_equal(one['lateral'].stamps_ns, one['speed'].stamps_ns)
    np.testing.assert_array_equal(one['speed'].values, np.full(52, 12.0))
    for source, words in (
        ('runs[:].plunge', r'3 structures: \[0\] to \[2\]'),
        ('runs.plunge', r'3 structures: \[0\] to \[2\]'),
        ('runs[3].plunge', r'no \[3\] in 3'),
        ('runs[0]', 'is a structure, expected one of plunge'),
        ('runs', 'array of 3 structures'),
    ):
        with pytest.raises(BagError, match=words):
            load_record(tmp_path / 'a.mat', [f'lateral={source}'], rate_hz=100.0)


def test_channels_of_tdms_have_groups_and_waveforms_their_times(
    tmp_path: Path,
) -> None:
    nptdms = pytest.importorskip('nptdms', reason='the extra tdms is not installed')
    begin = np.datetime64('2026-11-23T10:00:00.5', 'us')

    def channel(name: str, count: int, step: float, unit: str) -> object:
        about = {'wf_increment': step, 'wf_start_time': begin, 'wf_start_offset': 0.0}
        return nptdms.ChannelObject(
            'daq', name, np.arange(float(count)), {**about, 'unit_string': unit}
        )

    with nptdms.TdmsWriter(tmp_path / 'a.tdms') as writer:
        both = [channel('lateral', 500, 0.002, 'mm'), channel('speed', 100, 0.01, 'km/h')]
        writer.write_segment(both)
    with nptdms.TdmsWriter(tmp_path / 'b.tdms') as writer:
        writer.write_segment([nptdms.ChannelObject('daq', 'y', np.arange(50.0))])
    for source in ('y', 'daq/y'):
        bare = load_record(tmp_path / 'b.tdms', [f'lateral={source}*0.001'], rate_hz=10.0)
        np.testing.assert_array_equal(bare['lateral'].values, 0.001 * np.arange(50))
    record = load_record(tmp_path / 'a.tdms')
    assert record.start_ns == begin.astype('datetime64[ns]').astype(np.int64)
    np.testing.assert_array_equal(np.diff(record['lateral'].stamps_ns), 2_000_000)
    np.testing.assert_array_equal(np.diff(record['speed'].stamps_ns), 10_000_000)
    np.testing.assert_allclose(record['lateral'].values, 0.001 * np.arange(500))


def tdms_of(folder: Path, **channels: tuple) -> Path:
    """Return a file with these channels, each its values and its properties."""
    nptdms = pytest.importorskip('nptdms', reason='the extra tdms is not installed')
    with nptdms.TdmsWriter(folder / 'a.tdms') as writer:
        writer.write_segment([nptdms.ChannelObject('a', n, *of) for n, of in channels.items()])
    return folder / 'a.tdms'


@pytest.mark.parametrize(
    ('about', 'words'),
    [
        ({'wf_increment': 'quick'}, 'a/lateral: its waveform has no times'),
        ({'wf_increment': 0.01, 'wf_start_time': 'yesterday'}, 'its waveform has no times'),
        ({'wf_increment': 0.01, 'wf_start_offset': 'late'}, 'its waveform has no times'),
        ({'wf_increment': 0.01, 'wf_start_offset': 1e300}, 'no column of times'),
        ({'wf_increment': math.nan}, 'no column of times'),
        ({}, 'no column of times'),
    ],
)
def test_a_waveform_without_times_is_told_in_one_line(tmp_path, capsys, about, words) -> None:
    file = tdms_of(tmp_path, lateral=(np.arange(60.0), about))
    assert main(['import', str(file), str(tmp_path / 'out')]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line


def test_waveforms_that_share_no_time_are_no_recording(tmp_path, capsys) -> None:
    about = {'wf_increment': 0.002, 'wf_start_offset': 0.0}
    begin = np.datetime64('2026-11-23T10:00:00', 'us')
    file = tdms_of(
        tmp_path,
        lateral=(np.arange(600.0) * 1e-6, {**about, 'wf_start_time': begin}),
        speed=(0.01 * np.arange(600), {**about, 'wf_start_time': begin + np.timedelta64(1, 'h')}),
    )
    assert main(['import', str(file), str(tmp_path / 'out')]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert 'lateral ends 3598.802 s before speed begins' in line
    assert main(['import', str(file), str(tmp_path / 'out'), '--rate', '500']) == 0


def test_a_channel_of_words_is_told_as_such(tmp_path, capsys) -> None:
    file = tdms_of(tmp_path, lateral=(['a'] * 60, {}), t=(np.arange(60.0), {}))
    assert main(['import', str(file), str(tmp_path / 'out')]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert 'lateral is an array of 60 words or cells, expected numbers' in line


def test_objects_in_a_file_of_numpy_harm_no_other_column(tmp_path, capsys) -> None:
    columns = {'t': 1.0 + np.arange(60) / 100.0, 'lateral': 1e-3 * np.arange(60.0) / 60.0}
    file = tmp_path / 'a.npz'
    np.savez(file, note=np.array({'day': 1}, dtype=object), **columns)
    assert len(load_record(file)['lateral']) == 60
    assert main(['import', str(file), str(tmp_path / 'out'), '--channel', 'lateral=note']) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert 'note cannot be read' in line


def test_a_file_of_labview_has_its_units_in_front(tmp_path: Path) -> None:
    head = (
        'LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\t\nChannels\t2\t\t\n'
        'Samples\t9\t9\t\nDate\t2024/03/04\t2024/03/04\t\nY_Unit_Label\tmm\tkm/h\t\n'
        'X_Dimension\tTime\tTime\t\nX0\t0.0E+0\t0.0E+0\t\nDelta_X\t0.5\t0.5\t\n'
        '***End_of_Header***\t\t\t\nX_Value\tlateral\tspeed\tComment\n'
    )
    rows = (f'{0.5 * k}\t{k}\t36\n' for k in range(20))
    (tmp_path / 'a.lvm').write_text(head + ''.join(rows))
    record = load_record(tmp_path / 'a.lvm')
    np.testing.assert_allclose(record['lateral'].values, 1e-3 * np.arange(20))
    np.testing.assert_allclose(record['speed'].values, 10.0)
    assert set(np.diff(record['lateral'].stamps_ns)) == {5 * 10**8}


def test_units_in_names_are_told_by_every_format(tmp_path: Path) -> None:
    columns = {
        'Time [ms]': np.arange(4.0),
        'Lateral (mm)': np.arange(4.0),
        'speed [m/s]': np.ones(4),
    }
    np.savez(tmp_path / 'a.npz', **columns)
    record = load_record(tmp_path / 'a.npz')
    np.testing.assert_allclose(record['lateral'].values, 1e-3 * np.arange(4))
    np.testing.assert_array_equal(np.diff(record['speed'].stamps_ns), [10**6] * 3)
    assert 'units_assumed' not in record.notes


def test_who_gives_a_factor_knows_the_unit(tmp_path: Path) -> None:
    """The ending of a name may be no unit: M is the middle of the axle."""
    (tmp_path / 'a.csv').write_text('t;Weg_M;speed\ns;mm;m/s\n0;1;7\n1;2;7\n')
    record = load_record(tmp_path / 'a.csv', ['lateral=Weg_M*0.001'])
    np.testing.assert_allclose(record['lateral'].values, [1e-3, 2e-3])


def test_what_a_table_lacks_is_said(tmp_path: Path, capsys) -> None:
    (tmp_path / 'a.csv').write_text('t,rpm,lateral_mm\n' + ''.join(f'{k},1,2\n' for k in range(9)))
    assert main(['import', str(tmp_path / 'a.csv'), str(tmp_path / 'out')]) == 0
    assert 'no speed is in it' in capsys.readouterr().out


def test_a_column_never_takes_the_place_of_the_stamps(bag: Path, tmp_path: Path) -> None:
    out = tmp_path / 'a.csv'
    with pytest.raises(BagError, match='stamp_ns is the column of the stamps'):
        export_file(bag, out, ['stamp_ns=/rig/yaw'])
    assert not list(tmp_path.iterdir())


def test_a_recording_has_its_times(bag: Path) -> None:
    with pytest.raises(BagError, match='has its times'):
        load_record(bag, rate_hz=100.0)


def test_a_tdms_file_that_was_cut_says_so(tmp_path: Path, capfd) -> None:
    nptdms = pytest.importorskip('nptdms', reason='the extra tdms is not installed')
    about = {'wf_increment': 0.01, 'unit_string': 'm'}
    values = 1e-3 * np.sin(0.2 * np.arange(500))
    with nptdms.TdmsWriter(tmp_path / 'a.tdms') as writer:
        for _ in range(2):
            writer.write_segment([nptdms.ChannelObject('a', 'lateral', values, properties=about)])
    raw = (tmp_path / 'a.tdms').read_bytes()
    (tmp_path / 'a.tdms').write_bytes(raw[:-800])
    record = load_record(tmp_path / 'a.tdms')
    np.testing.assert_array_equal(record['lateral'].values, np.tile(values, 2)[:900])
    assert 'was cut' in record.notes['left_out']
    assert not capfd.readouterr().err


@pytest.mark.parametrize(
    ('rate', 'ticks'), [(1200, 1e3), (1500, 1e3), (5000, 1e3), (250, 1e2), (200, 1)]
)
@pytest.mark.parametrize('half', [0.0, 0.5])
def test_samples_that_share_a_time_are_taken_as_sampled_evenly_and_said_so(
    tmp_path: Path, capsys, rate: int, ticks: float, half: float
) -> None:
    """A logger of 5 kHz that writes milliseconds; one of 200 Hz that writes seconds; rounded."""
    times = 0.3 + np.arange(12 * rate) / rate
    file = tmp_path / 'daq.csv'
    told = np.floor(times * ticks + half + 1e-6) / ticks
    file.write_text('t,lateral\n' + ''.join(f'{time:.3f},0.001\n' for time in told))
    assert main(['import', str(file), str(tmp_path / 'run')]) == 0
    assert f'taken as sampled evenly at {rate} Hz' in capsys.readouterr().out
    stamps = read_record(tmp_path / 'run')['lateral'].stamps_ns * 1e-9
    np.testing.assert_allclose(np.diff(stamps), 1.0 / rate, rtol=1e-3)
    main(['check', str(tmp_path / 'run')])
    assert 'a sample that was lost does not show' in capsys.readouterr().out


@pytest.mark.parametrize('code', ['-9999', '9999.9', '-1e30', '3.4e38'])
def test_a_code_for_no_reading_is_no_number(tmp_path: Path, code: str) -> None:
    file = tmp_path / 'daq.csv'
    cells = ['0.001', '-0.002', code, '0.003'] * 20
    file.write_text(
        'lateral,speed\n' + ''.join(f'{cell},{900 + 99 * (cell == code)}\n' for cell in cells)
    )
    record = load_record(file, rate_hz=100.0)
    assert np.isnan(record['lateral'].values).tolist() == [cell == code for cell in cells]
    # A number that others come near to is one.
    assert record['speed'].values.max() == 999.0


@pytest.mark.parametrize(
    ('step', 'start', 'unit'), [(1.0, 0.0, 1e-3), (5.0, 12.0, 1e-3), (1e-7, 45_000.5, 86_400)]
)
def test_times_in_milliseconds_or_days_are_not_taken_for_seconds(
    tmp_path: Path, step: float, start: float, unit: float
) -> None:
    file = tmp_path / 'daq.csv'
    rows = (f'{start + step * row:.12f},0.001\n' for row in range(100))
    file.write_text('time,lateral\n' + ''.join(rows))
    with pytest.raises(BagError, match='in which unit'):
        load_record(file)
    assert load_record(file, time=f'time*{unit}')['lateral'].values.size == 100
