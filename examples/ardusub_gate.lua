-- A gate for ArduSub: a program outside sets the pulses of the thrusters, while all of this holds:
--   its frames are new, whole, at most 100 ms old, and from the ground station's system number;
--   the vehicle is armed and in MANUAL; the frame's export is the one below;
--   SERVO1.. are Motor1.., and FRAME_CONFIG and the directions MOT_n_DIRECTION are as the frame believes.
-- Otherwise the pulses are neutral for 100 ms, and then ArduSub's mixer has the motors again. A session that met a reason
-- to stop, or was silent for a second, is over: a program that is started again takes another number.
--
-- A frame is TUNNEL (385) of payload type 40001, in little endian: counter u32, session u16, version u8 = 1, thrusters u8,
-- directions u8 (bit n-1 set: MOT_n_DIRECTION is -1), FRAME_CONFIG u8, export as text of 16 bytes, a pulse u16 a motor.
-- Copy this file to APM/scripts of the autopilot, with SCR_ENABLE 1 and SCR_HEAP_SIZE of at least 100000.
local EXPORT = ''                 -- the number of the export that may drive this vehicle, from its README

local EVERY, FRESH, REST, SILENT = 5, 100, 100, 1000          -- ms
local MANUAL, TUNNEL, EXTRA, KIND = 19, 385, 147, 40001
local NEUTRAL, LEAST, MOST = 1500, 1100, 1900                 -- us
local YOUNG = 50                  -- a session begins with one of its first frames, also if this script was started again
local QUEUE, LONGEST = 25, 47     -- frames, and bytes of a payload with eight motors

mavlink:init(QUEUE, 1)
mavlink:register_rx_msgid(TUNNEL)
local ground = param:get('SYSID_MYGCS') or param:get('MAV_GCS_SYSID')
local own = param:get('SYSID_THISMAV') or param:get('MAV_SYSID')

local order = nil                 -- the last frame that was taken: at, counter, session, pulses, directions, frame, export
local over = {}                   -- sessions that are over
local opened, closed_at, driven = false, nil, 0
local taken, refused = 0, 0
local looked_at, wrong = nil, nil -- the parameters: when they were read, and which one is not as the frame believes
local told_at = 0

-- CRC-16/MCRF4XX of the bytes from the length to the payload's end; scripts are given damaged frames, too
local function is_whole(f, length)
  local bytes, crc = { f:byte(4, length + 12) }, 0xFFFF
  bytes[#bytes + 1] = EXTRA
  for k = 1, #bytes do
    local x = bytes[k] ~ crc & 0xFF
    x = (x ~ x << 4) & 0xFF
    crc = crc >> 8 ~ x << 8 ~ x << 3 ~ x >> 4
  end
  return crc & 0xFFFF == f:byte(1) | f:byte(2) << 8
end

-- The order in a message, or nil
local function order_of(f, at)
  local length = f:byte(4)
  if f:byte(3) ~= 0xFD or length > LONGEST or f:byte(8) ~= ground or f:byte(10) | f:byte(11) << 8 | f:byte(12) << 16 ~= TUNNEL then return end
  local body = f:sub(13, 12 + length) .. string.rep('\0', 48)     -- MAVLink 2 leaves the last zeros out
  local kind, target, _, _, counter, session, version, n, directions, frame, export = string.unpack('<HBBBI4HBBBBc16', body)
  if kind ~= KIND or target ~= own or version ~= 1 or n < 1 or n > 8 or session == 0 or over[session] then return end
  if order and order.session == session then
    if counter <= order.counter then return end
  elseif opened or counter < 1 or counter > YOUNG then
    return                                                     -- one session at a time, from its beginning
  end
  if not is_whole(f, length) then return end
  local pulses = {}
  for k = 1, n do
    pulses[k] = string.unpack('<H', body, 30 + 2 * k)
    if pulses[k] < LEAST or pulses[k] > MOST then return end
  end
  return { at = at, counter = counter, session = session, pulses = pulses, directions = directions, frame = frame,
           export = export:gsub('\0+$', '') }
end

-- Empty the queue, and take its newest order; two are looked at, since a script has 10,000 instructions a call
local function receive()
  local newest, before
  for _ = 1, QUEUE do
    local f, _, at = mavlink:receive_chan()
    if not f then break end
    before, newest = newest, { f, at:toint() }
  end
  for _, each in ipairs({ newest, before }) do
    local found = order_of(each[1], each[2])
    if found then
      if not order or found.session ~= order.session then looked_at = nil end
      order, taken = found, taken + 1
      return
    end
    refused = refused + 1
  end
end

-- The first parameter that is not as the order believes
local function wrong_parameter()
  for n = 1, #order.pulses do
    local is = order.directions >> (n - 1) & 1 == 1 and -1 or 1
    if param:get('SERVO' .. n .. '_FUNCTION') ~= 32 + n then return 'SERVO' .. n .. '_FUNCTION' end
    if param:get('MOT_' .. n .. '_DIRECTION') ~= is then return 'MOT_' .. n .. '_DIRECTION' end
  end
  if param:get('FRAME_CONFIG') ~= order.frame then return 'FRAME_CONFIG' end
end

-- Why the order may not drive, or nil; whether it is armed is asked last, since the mode may wait for the main loop
local function reason()
  if EXPORT == '' then return 'EXPORT is not set' end
  if order.export ~= EXPORT then return 'another export' end
  local now = millis():toint()
  if not looked_at or now - looked_at >= 1000 then looked_at, wrong = now, wrong_parameter() end
  if wrong then return wrong end
  if vehicle:get_mode() ~= MANUAL then return 'not MANUAL' end
  if not arming:is_armed() then return 'disarmed' end
end

local function drive(n, pulses, ms)
  for k = 1, n do SRV_Channels:set_output_pwm_chan_timeout(k - 1, pulses and pulses[k] or NEUTRAL, ms) end
  driven = n
end

local function update()
  receive()
  local live = order and not over[order.session]
  local why = live and reason()
  local now = millis():toint()
  local age = live and now - order.at
  if why or (live and age > SILENT) then
    if why and not opened then gcs:send_text(4, 'gate: refused, ' .. why) end
    over[order.session] = true
  end
  if live and not why and age <= FRESH then
    if not opened then gcs:send_text(6, 'gate: open, session ' .. order.session) end
    opened = true
    drive(#order.pulses, order.pulses, FRESH - age + 2 * EVERY) -- it ends by itself if this script dies
  else
    if opened then
      opened, closed_at = false, now
      gcs:send_text(4, 'gate: closed, ' .. (why or 'no fresh frames'))
    end
    if closed_at and now - closed_at < REST then drive(driven, nil, 2 * EVERY) end
  end
  if now - told_at >= 500 then
    told_at = now
    gcs:send_named_float('GATE', opened and order.session or 0)
    gcs:send_named_float('GATE_SEQ', order and order.counter or 0) -- by which the sender knows how late its frames come
    gcs:send_named_float('GATE_OK', taken)
    gcs:send_named_float('GATE_BAD', refused)
  end
  return update, EVERY
end

gcs:send_text(6, 'gate: loaded')
return update()
