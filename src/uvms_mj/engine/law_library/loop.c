/* The processor in the loop, or on the vehicle: this program takes measurements over UDP on this machine or over a serial
   line, steps the law, and answers with its command.

   cc -std=c99 loop.c TARGET/libLAW.a -o loop && ./loop [PORT] or ./loop /dev/ttyAMA0 [BAUD]

   TARGET is the folder of the processor that runs it. README.md has the line of each compiler.

   A request of a run of uvms-mj, --controller udp: "uvms-mj1", the number of the instant (uint64), and the record of
   signals of a run. Its answer: the number of the instant, tau_cmd, the status of the law (int64), the numbers of the
   export and of the record (uint64), and the thrust of each thruster.

   A frame, on the line or as a datagram: "uvms-mj2", the bytes of its body and their complement (uint32), the number of
   the instant, LAW_LAYOUT (uint64), the body, and the CRC-32 of all before it (uint32, as zlib has it). The body is
   struct given, and in the answer struct found. All are little endian. */
#define _POSIX_C_SOURCE 200112L
#define _DEFAULT_SOURCE /* bauds above 38400 */
#include "law.h"
#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#define SIGNALS UINT64_C(LAYOUT_OF_SIGNALS) /* the number of the record of signals */
#define NUMBERS SIGNALS_COUNT /* its words of 8 bytes */
#define MOST 4096 /* bytes of a frame */
#define QUIET 100 /* [ms] of silence after which the rest of a frame does not come any more */
#define NO_INSTANT UINT64_MAX

struct request {
    char magic[8];
    uint64_t instant;
    double signals[NUMBERS];
};

struct answer {
    uint64_t instant;
    double tau_cmd[6];
    int64_t status;
    uint64_t export_number, signals;
    double thrusts[LAW_THRUSTERS];
};

struct front {
    char magic[8];
    uint32_t size, complement;
    uint64_t instant, layout;
};

struct given {
    law_measured measured;
REFERENCE_STRUCT};

struct found {
    int64_t status;
    uint64_t export_number, skipped; /* bytes that were no frame, since the program began */
    law_command command;
};

static LAW instance;

/* The words of a signal, which has a place in the record. */
static void take(double *to, const struct request *request, int place, int n)
{
    memcpy(to, request->signals + place, sizeof(double) * (unsigned)n);
}

/* Step the law. Instant 0 begins a run, and the law anew. Below LAW_OK the command is neutral. */
static int step(const struct request *request, law_command *command)
{
    law_measured measured;
    law_settings settings;
REFERENCE_STRUCT    int status = request->instant == 0 ? law_init(&instance) : LAW_OK;
    law_neutral(command);
    if (status == LAW_OK)
        status = law_get(&instance, &settings);
    if (status != LAW_OK)
        return status;
SETTINGS    status = law_set(&instance, &settings);
    if (status != LAW_OK)
        return status;
    take(&measured.t, request, 0, 1);
    measured.present = PRESENT_IN_A_REQUEST;
MEASUREDREFERENCE    return law_step(&instance, &measured, REFERENCE_ARGUMENTcommand);
}

/* CRC-32 of bytes. */
static uint32_t crc_of(const unsigned char *data, unsigned n)
{
    uint32_t crc = UINT32_C(0xffffffff);
    int bit;
    while (n--)
        for (crc ^= *data++, bit = 0; bit < 8; bit++)
            crc = crc >> 1 ^ (crc & 1 ? UINT32_C(0xedb88320) : 0);
    return ~crc;
}

static struct {
    uint64_t instant;
    struct found found;
    unsigned char data[sizeof(struct front) + sizeof(struct found) + 4];
} reply = {.instant = NO_INSTANT};

/* Put the answer in hand into its frame. */
static void pack(uint64_t instant)
{
    struct front front = {"", sizeof reply.found, ~(uint32_t)sizeof reply.found, instant, LAW_LAYOUT};
    uint32_t crc;
    memcpy(front.magic, "uvms-mj2", sizeof front.magic);
    reply.found.export_number = law_export();
    memcpy(reply.data, &front, sizeof front);
    memcpy(reply.data + sizeof front, &reply.found, sizeof reply.found);
    crc = crc_of(reply.data, sizeof reply.data - sizeof crc);
    memcpy(reply.data + sizeof reply.data - sizeof crc, &crc, sizeof crc);
}

/* Answer what has no measurements for the law: a neutral command, of which the law knows, too. */
static void refuse(int status, uint64_t instant)
{
    struct given given;
    memset(&given, 0xff, sizeof given); /* no numbers */
    law_step(&instance, &given.measured, FRAME_ARGUMENT&reply.found.command);
    reply.found.status = status;
    reply.instant = NO_INSTANT;
    pack(instant);
}

/* Answer a whole frame. Instant 0 begins the law anew; a frame that comes again gets the same answer. */
static void answer_frame(const unsigned char *data)
{
    struct front front;
    struct given given;
    memcpy(&front, data, sizeof front);
    if (front.layout != LAW_LAYOUT || front.size != sizeof given) {
        refuse(LAW_OTHER_HEADER, front.instant);
        return;
    }
    if (front.instant != reply.instant || front.instant == NO_INSTANT) {
        memcpy(&given, data + sizeof front, sizeof given);
        law_neutral(&reply.found.command);
        reply.found.status = front.instant == 0 ? law_init(&instance) : LAW_OK;
        if (reply.found.status == LAW_OK)
            reply.found.status = law_step(&instance, &given.measured, FRAME_ARGUMENT&reply.found.command);
        reply.instant = front.instant;
    }
    pack(front.instant);
}

/* The bytes of the whole frame that data begin with; 0 if some are to come, below zero if they begin none. */
static long frame_of(const unsigned char *data, unsigned n)
{
    struct front front;
    uint32_t crc;
    unsigned size;
    if (memcmp(data, "uvms-mj2", n < 8 ? n : 8) != 0)
        return -1;
    if (n < sizeof front)
        return 0;
    memcpy(&front, data, sizeof front);
    size = (unsigned)sizeof front + front.size + 4;
    if (front.complement != ~front.size || front.size > MOST - sizeof front - 4)
        return -1;
    if (n < size)
        return 0;
    memcpy(&crc, data + size - 4, 4);
    return crc == crc_of(data, size - 4) ? (long)size : -1;
}

static const struct {
    long baud;
    speed_t speed;
} speeds[] = {
    {9600, B9600},     {19200, B19200},   {38400, B38400},
#ifdef B57600
    {57600, B57600},   {115200, B115200}, {230400, B230400},
#endif
#ifdef B460800
    {460800, B460800},
#endif
#ifdef B921600
    {921600, B921600},
#endif
#ifdef B1500000
    {1500000, B1500000},
#endif
};

/* A serial line: eight bits, no parity, and no byte that means something to the system. Below zero: errors. */
static int line_of(const char *device, long baud)
{
    struct termios how;
    unsigned k, n = sizeof speeds / sizeof *speeds;
    int line = open(device, O_RDWR | O_NOCTTY | O_NONBLOCK); /* without a carrier, too */
    for (k = 0; k < n && speeds[k].baud != baud; k++)
        ;
    if (k == n)
        return -2;
    if (line < 0 || tcgetattr(line, &how) < 0)
        return -1;
    how.c_iflag = IGNBRK;
    how.c_oflag = 0;
    how.c_lflag = 0;
    how.c_cflag = CS8 | CREAD | CLOCAL;
    how.c_cc[VMIN] = 1;
    how.c_cc[VTIME] = 0;
    if (cfsetispeed(&how, speeds[k].speed) < 0 || cfsetospeed(&how, speeds[k].speed) < 0)
        return -1;
    return tcsetattr(line, TCSANOW, &how) < 0 ? -1 : line;
}

/* Send the reply. Bytes that the line does not take in time are left out. */
static void send_reply(int line)
{
    unsigned sent = 0;
    while (sent < sizeof reply.data) {
        struct pollfd ready = {0, POLLOUT, 0};
        long n = (long)write(line, reply.data + sent, sizeof reply.data - sent);
        ready.fd = line;
        if (n > 0)
            sent += (unsigned)n;
        else if (poll(&ready, 1, QUIET) != 1 || !(ready.revents & POLLOUT))
            return;
    }
}

/* Answer the frames of a line until it is closed. Bytes that begin no frame are skipped one by one, so that a frame
   within them is found. They are answered when the line is silent, unless a frame came behind them. */
static int serve_line(int line)
{
    static unsigned char data[MOST];
    unsigned held = 0;
    int damaged = 0;
    for (;;) {
        struct pollfd ready = {0, POLLIN, 0};
        int silent;
        ready.fd = line;
        silent = poll(&ready, 1, QUIET) == 0;
        if (!silent) {
            long got = ready.revents & POLLIN ? (long)read(line, data + held, MOST - held) : 0;
            if (got <= 0)
                return 1;
            held += (unsigned)got;
        }
        while (held) {
            long size = frame_of(data, held);
            if (size == 0 && !silent)
                break; /* its rest is to come */
            damaged = size <= 0;
            if (damaged) {
                size = 1;
                reply.found.skipped++;
            } else {
                answer_frame(data);
                send_reply(line);
            }
            held -= (unsigned)size;
            memmove(data, data + size, held);
        }
        if (damaged && silent) {
            refuse(LAW_DAMAGED, NO_INSTANT);
            send_reply(line);
            damaged = 0;
        }
    }
}

/* The number of a text, which is not above most; or 0. */
static long number_of(const char *text, long most)
{
    long number = 0;
    for (; *text; text++) {
        if (*text < '0' || *text > '9' || number > most)
            return 0;
        number = 10 * number + *text - '0';
    }
    return number <= most ? number : 0;
}

static int serve_port(int port)
{
    static unsigned char data[MOST + sizeof(struct request)]; /* a longer one is told from a request and a frame */
    static struct request request;
    static struct answer answer;
    struct sockaddr_in here, asked, from;
    int begun = 0, peer = socket(AF_INET, SOCK_DGRAM, 0);
    memset(&here, 0, sizeof here);
    memset(&asked, 0, sizeof asked);
    here.sin_family = AF_INET;
    here.sin_port = htons((uint16_t)port);
    here.sin_addr.s_addr = htonl(INADDR_LOOPBACK); /* no other machine is heard */
    if (peer < 0 || bind(peer, (const struct sockaddr *)&here, sizeof here) < 0) {
        printf("UDP port %d of 127.0.0.1 is not free; give another\n", port);
        return 2;
    }
    answer.export_number = law_export();
    answer.signals = SIGNALS;
    for (;;) {
        socklen_t size = sizeof from;
        long got = (long)recvfrom(peer, data, sizeof data, 0, (struct sockaddr *)&from, &size);
        int other = from.sin_port != asked.sin_port || from.sin_addr.s_addr != asked.sin_addr.s_addr;
        int framed = got >= (long)sizeof(struct front) && memcmp(data, "uvms-mj2", 8) == 0;
        if (got < 0) {
            printf("the socket fails\n");
            return 1;
        }
        if (!framed && (got != (long)sizeof request || memcmp(data, "uvms-mj1", 8) != 0))
            continue;
        memcpy(&request, data, framed ? sizeof(struct front) : sizeof request);
        memcpy(&request.instant, data + (framed ? 16 : 8), sizeof request.instant);
        if (begun && other && request.instant != 0)
            continue; /* of a run that a later one has replaced */
        if (framed) {
            if (frame_of(data, (unsigned)got) == got)
                answer_frame(data);
            else
                refuse(LAW_DAMAGED, NO_INSTANT);
            sendto(peer, reply.data, sizeof reply.data, 0, (const struct sockaddr *)&from, size);
        } else {
            if (!begun || other || request.instant != answer.instant) { /* not one that comes again */
                law_command command;
                answer.status = step(&request, &command);
                answer.instant = request.instant;
                memcpy(answer.tau_cmd, command.tau_cmd, sizeof answer.tau_cmd);
                memcpy(answer.thrusts, command.u_cmd, sizeof answer.thrusts);
            }
            sendto(peer, &answer, sizeof answer, 0, (const struct sockaddr *)&from, size);
        }
        asked = from;
        begun = 1;
    }
}

int main(int count, char **arguments)
{
    const char *where = count > 1 ? arguments[1] : "STANDARD_PORT", *baud = count > 2 ? arguments[2] : "115200";
    long port = number_of(where, 65535);
    int line;
    if (count > 3 || (port == 0 && *where != '/') || (port != 0 && count > 2)) {
        printf("loop [PORT]: a UDP port of this machine, 1 to 65535\nloop DEVICE [BAUD]: a serial line, /dev/...\n");
        return 2;
    }
    if (port != 0)
        return serve_port((int)port);
    line = line_of(where, number_of(baud, 10000000));
    if (line < 0) {
        printf(line == -2 ? "%s: %s is no baud of a serial line\n" : "%s: is no serial line of %s baud\n", where, baud);
        return 2;
    }
    return serve_line(line);
}
