/* The processor in the loop: this program answers a run of uvms-mj, --controller udp, over UDP on this machine. It takes
   the measurements from each request, steps the law, and answers with its command.

   cc -std=c99 loop.c TARGET/libLAW.a -o loop && ./loop [PORT]

   A request: "uvms-mj1", the number of the instant (uint64), and the record of signals of a run. An answer: the number of
   the instant, tau_cmd, the status of the law (int64), the numbers of the export and of the record (uint64), and the
   thrust of each thruster. All are little endian. */
#define _POSIX_C_SOURCE 200112L
#include "law.h"
#include <arpa/inet.h>
#include <netinet/in.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>

#define SIGNALS UINT64_C(LAYOUT_OF_SIGNALS) /* the number of the record of signals */
#define NUMBERS SIGNALS_COUNT /* its words of 8 bytes */

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
    measured.present = LAW_NEEDED;
MEASUREDREFERENCE    return law_step(&instance, &measured, REFERENCE_ARGUMENTcommand);
}

/* The port of a text, or 0. */
static int port_of(const char *text)
{
    int port = 0;
    for (; *text; text++) {
        if (*text < '0' || *text > '9' || port > 6553)
            return 0;
        port = 10 * port + *text - '0';
    }
    return port < 65536 ? port : 0;
}

int main(int count, char **arguments)
{
    static unsigned char data[sizeof(struct request) + 1]; /* a longer one is told from a request */
    static struct request request;
    static struct answer answer;
    struct sockaddr_in here, asked, from;
    int begun = 0, port = count > 1 ? port_of(arguments[1]) : STANDARD_PORT, peer = socket(AF_INET, SOCK_DGRAM, 0);
    if (count > 2 || port == 0) {
        printf("loop [PORT]: a UDP port of this machine, 1 to 65535\n");
        return 2;
    }
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
        if (got < 0) {
            printf("the socket fails\n");
            return 1;
        }
        if (got != (long)sizeof request || memcmp(data, "uvms-mj1", 8) != 0)
            continue;
        memcpy(&request, data, sizeof request);
        if (begun && other && request.instant != 0)
            continue; /* of a run that a later one has replaced */
        if (!begun || other || request.instant != answer.instant) { /* not one that comes again */
            law_command command;
            answer.status = step(&request, &command);
            answer.instant = request.instant;
            memcpy(answer.tau_cmd, command.tau_cmd, sizeof answer.tau_cmd);
            memcpy(answer.thrusts, command.u_cmd, sizeof answer.thrusts);
            asked = from;
            begun = 1;
        }
        sendto(peer, &answer, sizeof answer, 0, (const struct sockaddr *)&from, size);
    }
}
