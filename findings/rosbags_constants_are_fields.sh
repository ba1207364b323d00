#!/usr/bin/env bash
# rosbags: the constants of a message type, declared ClassVar, are fields of each of its messages.
#
# Version: rosbags 0.11.9, Python 3.11.
#
# Behaviour: dataclasses.fields() and asdict() of a message list the constants of its type and
# __msgtype__, the constructor takes them as arguments, and messages that differ in a constant alone
# are not equal. So it is for the types that rosbags contains and for those that a text defines.
#
# Why it surprises: the source of the classes says "STATUS_FIX: ClassVar[int] = 0", which dataclass
# leaves out of the fields. But annotations are strings there, and ClassVar is imported under
# TYPE_CHECKING only. dataclass looks for the name in the module, does not find it, and takes the
# annotation for that of a field, without an error. Type checkers see a ClassVar. Code that copies
# or compares messages field by field, or makes a dict or a table of them, has the constants, too.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat >"$folder/check.py" <<'PYTHON'
import dataclasses
import inspect
import sys
from importlib.metadata import version

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

store = get_typestore(Stores.ROS2_JAZZY)
store.register(get_types_from_msg('int8 STATUS_FIX=0\nint8 status\n', 'own/msg/Status'))
builtin, own = (store.types[name] for name in ('sensor_msgs/msg/NavSatStatus', 'own/msg/Status'))
print('rosbags', version('rosbags'), 'Python', sys.version.split()[0])
declared = 'STATUS_FIX: ClassVar[int] = 0' in inspect.getsource(builtin)
print('declared as ClassVar:', declared)
fields = {
    kind.__msgtype__: [field.name for field in dataclasses.fields(kind)] for kind in (builtin, own)
}
print('fields:', fields)
message = own(status=1)
changed = dataclasses.replace(message, STATUS_FIX=7)
print(dataclasses.asdict(message), 'differs from', dataclasses.asdict(changed))
surprising = (
    declared
    and all({'STATUS_FIX', '__msgtype__'} <= {*names} for names in fields.values())
    and message != changed
    and own.STATUS_FIX == 0
    and 'STATUS_FIX' not in {name for name, _ in store.fielddefs['own/msg/Status'][1]}
)
sys.exit(not surprising)
PYTHON
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet 'rosbags==0.11.9'
"$folder/venv/bin/python" "$folder/check.py"
