"""A stand-in for an ArduSub that runs a script: the calls of examples/ardusub_gate.lua as ArduSub's sources have them,
around the script in a real Lua 5.3. Its loop has 400 Hz. Overrides of pulses are counted in loops, and the mixer has a
channel without one. Scripts get the frames of a message in the order in which they came, damaged ones too; a full
queue drops the newest. A call of more than 10,000 instructions ends the script for good. Integers of 32 bits and the
limit of memory are not modelled."""

from typing import Any

from lupa import lua53

LOOP_US = 2500
INSTRUCTIONS = 10_000
_LIMIT = b"""
local most = 0
local function limited(f)
    local n = 0
    debug.sethook(function()
        n = n + 1
        if n > %d then debug.sethook() error('too many instructions') end
    end, '', 1)
    local ok, again, after = pcall(f)
    debug.sethook()
    if n > most then most = n end
    if not ok then error(again, 0) end
    return again, after
end
return limited, function() return most end
"""


class Standin:
    """An ArduSub with a script. ``mixer`` has the pulses of channels that are not overridden [us]."""

    def __init__(self, script: str, n: int = 8, **parameters: float) -> None:
        self.parameters: dict[str, float] = {"SYSID_MYGCS": 255.0, "SYSID_THISMAV": 1.0, "FRAME_CONFIG": 2.0}
        for k in range(1, n + 1):
            self.parameters |= {f"SERVO{k}_FUNCTION": 32.0 + k, f"MOT_{k}_DIRECTION": 1.0}
        self.parameters |= parameters
        self.us, self.armed, self.mode = 0, True, 19
        self.mixer, self.forced, self.loops = [1600] * n, [1500] * n, [0] * n
        self.texts: list[str] = []
        self.floats: dict[str, float] = {}
        self.sent: list[tuple[str, float]] = []
        """The named floats in the order in which they were sent."""
        self.ended = ""
        self.stalls_us = 0
        """Time that the next call of vehicle:get_mode waits for the main loop, which goes on."""
        self._script, self._queue, self._depth, self._listens = script, list[tuple[bytes, int]](), 0, set[int]()
        self.start()

    def start(self) -> None:
        """Start the script; a second time as after scripting is restarted."""
        lua = lua53.LuaRuntime(encoding=None, unpack_returned_tuples=True)
        calls: dict[str, dict[str, Any]] = {
            "mavlink": {"init": self._init, "register_rx_msgid": self._listen, "receive_chan": self._receive},
            "param": {"get": lambda _, name: self.parameters.get(name.decode())},
            "arming": {"is_armed": lambda _: self.armed},
            "vehicle": {"get_mode": self._get_mode},
            "SRV_Channels": {"set_output_pwm_chan_timeout": self._force},
            "gcs": {
                "send_text": lambda _, severity, text: self.texts.append(text.decode()),
                "send_named_float": self._send_float,
            },
        }
        names = lua.globals()
        for name, methods in calls.items():
            names[name.encode()] = lua.table_from({key.encode(): value for key, value in methods.items()})
        self._u32 = lua.eval(b"function(x) return { toint = function() return x end } end")
        names[b"millis"] = lambda: self._u32(self.us // 1000)
        self._limited, self.instructions = lua.execute(_LIMIT % INSTRUCTIONS)
        self._queue.clear()
        self._call = lua.eval(b"function(text) return assert(load(text, 'script')) end")(self._script.encode())
        self._next, self.ended = self.us, ""

    def _init(self, _: Any, depth: int, messages: int) -> None:
        assert messages >= 1
        self._depth = depth

    def _listen(self, _: Any, message: int) -> bool:
        self._listens.add(message)
        return True

    def _receive(self, _: Any) -> Any:
        if not self._queue:
            return None
        data, ms = self._queue.pop(0)
        return data, 0, self._u32(ms)

    def _get_mode(self, _: Any) -> int:
        mode, stalls = self.mode, self.stalls_us
        self.stalls_us = 0
        for _ in range(stalls // LOOP_US):
            self._outputs()
        return mode

    def _send_float(self, _: Any, name: bytes, value: float) -> None:
        self.floats[name.decode()] = float(value)
        self.sent.append((name.decode(), float(value)))

    def _force(self, _: Any, channel: int, pulse: int, ms: int) -> None:
        assert isinstance(pulse, int)
        assert ms >= 0
        self.forced[channel], self.loops[channel] = pulse, -(-ms * 1000 // LOOP_US)

    def give(self, wire: bytes) -> None:
        """A frame of MAVLink 2 as it is on the wire, from its mark to its checksum."""
        n = wire[1]
        front, payload, checksum = wire[:10], wire[10 : 10 + n], wire[10 + n : 12 + n]
        number = int.from_bytes(wire[7:10], "little")
        if number in self._listens and len(self._queue) < self._depth:
            self._queue.append(((checksum + front + payload).ljust(291, b"\0"), self.us // 1000))

    def _outputs(self) -> list[int]:
        """The pulses of a loop."""
        out = []
        for k, pulse in enumerate(self.mixer):
            out.append(self.forced[k] if self.loops[k] else pulse)
            self.loops[k] = max(0, self.loops[k] - 1)
        self.us += LOOP_US
        return out

    def loop(self) -> list[int]:
        """A loop of 2.5 ms; the pulses of the motors [us]."""
        if not self.ended and self.us >= self._next:
            try:
                self._call, ms = self._limited(self._call)
                self._next = self.us + int(ms) * 1000
            except lua53.LuaError as error:
                self.ended = str(error)
        return self._outputs()
