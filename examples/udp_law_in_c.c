/* A law in C in a process of its own: PD about the reference.

   printf 'stage = "controller"\n' > udp_law_in_c.toml && uvms-mj new header udp_law_in_c.toml     writes uvms_stage.h
   cc -O2 -ffp-contract=off -o udp_law_in_c udp_law_in_c.c -lm && ./udp_law_in_c                       in one terminal
   uvms-mj run --controller udp controller.period=1e-3                                  in another one */
#include <arpa/inet.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

#include "uvms_stage.h"

static void law(const struct signals *signals, double *tau_cmd)
{
    for (int i = 0; i < 6; i++)
        tau_cmd[i] = signals->g_hat[i] - 200.0 * signals->eta_e[i] - 150.0 * signals->nu_e[i];
}

int main(int count, char **arguments)
{
    struct { char magic[8]; uint64_t instant; struct signals signals; } request;
    struct { uint64_t instant; double tau_cmd[6]; } answer = {UINT64_MAX, {0}};
    struct sockaddr_in asked = {0}, here = {.sin_family = AF_INET, .sin_port = htons(count > 1 ? atoi(arguments[1]) : 9100)}, there;
    int peer = socket(AF_INET, SOCK_DGRAM, 0);
    here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (bind(peer, (struct sockaddr *)&here, sizeof here)) {
        perror("the port");
        return 2;
    }
    for (;;) {
        socklen_t size = sizeof there;
        ssize_t got = recvfrom(peer, &request, sizeof request, 0, (struct sockaddr *)&there, &size);
        if (got != sizeof request || memcmp(request.magic, "uvms-mj1", 8) != 0)
            continue;
        if (request.instant != answer.instant || memcmp(&asked, &there, sizeof there) != 0) { /* not one that comes again */
            answer.instant = request.instant;
            asked = there;
            law(&request.signals, answer.tau_cmd);
        }
        sendto(peer, &answer, sizeof answer, 0, (struct sockaddr *)&there, size);
    }
}
